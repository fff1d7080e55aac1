"""`data inspect`: sites, chains and vehicles of recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.foreign import one_line
from socialiq_recordings.cli.recorded_files import load_all, show_overlaps
from socialiq_recordings.identity.duplicates import check_names
from socialiq_recordings.identity.identify import identify
from socialiq_recordings.simulated_source import signs_of_simulation


@dataclass(frozen=True)
class Inspect:
    """Count the sites, the independent chains and the different vehicles of recordings.

    Sites are compared by the geometry of their lanes, vehicles by their motion.

    Example: socialiq data inspect lankershim/*.safetensors
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Read, identify, print."""
        recordings = load_all(self.recordings)
        check_names([one.tracks.recording for one in recordings])
        found = identify(recordings)
        rows: list[dict[str, Any]] = [
            {
                "recording": one.tracks.recording,
                "site": site,
                "chain": chain,
                "seconds": round(float((one.tracks.frame.max() + 1) * one.tracks.dt), 2),
                "tracks": one.tracks.n_tracks,
                "lanelets": len(one.road.lanelets),
                "simulated": "; ".join(signs_of_simulation(one.tracks)),
            }
            for one, site, chain in zip(recordings, found.site, found.chain, strict=True)
        ]
        counts = {
            "recordings": len(rows),
            "sites": len(set(found.site)),
            "chains": len(set(found.chain)),
            "tracks": sum(row["tracks"] for row in rows),
            "vehicles": found.n_vehicles,
        }
        if self.json:
            print_json({"counts": counts, "recordings": rows, "overlaps": found.rows()})
            return 0
        for row in rows:
            texts = ("recording", "site", "chain", "simulated")
            row |= {name: one_line(row[name], 80) for name in texts}
        print_table(rows, "Recordings")
        show_overlaps(found)
        print_table([{"number of": name, "count": count} for name, count in counts.items()])
        return 0
