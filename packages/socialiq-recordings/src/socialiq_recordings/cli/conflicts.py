"""`data conflicts`: conflicts of recorded vehicles, their measures, and pictures of them."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError
from socialiq.results_folder import Results, check_target, save
from socialiq.types import Row
from socialiq_recordings.cli.files import OfDistinct, not_used, sources_of
from socialiq_recordings.conflicts.encounters import ConflictConfig, Encounters, Meeting
from socialiq_recordings.conflicts.measures import rows_of
from socialiq_recordings.identity.identify import Identified, pairs_once
from socialiq_recordings.road.routes import Scene

Case = tuple[Encounters, Meeting, Row]

MOST_PICTURES = 200  # largest number of pictures of a call


@dataclass(frozen=True)
class FindConflicts(OfDistinct):
    """List conflicts of recorded vehicles with PET, TTC, gaps and required decelerations.

    Example: socialiq data conflicts junction.safetensors --out conflicts --pictures 20
    """

    out: Path | None = None
    """Folder to write: conflicts, counts by recording, pictures."""
    largest_pet: float = ConflictConfig.near
    """Seconds between two vehicles in an area above which they are in no conflict."""
    horizon: float = ConflictConfig.horizon
    """Seconds ahead in which both must arrive at their present speeds."""
    queued: bool = False
    """Also list conflicts of vehicles that are behind others of their lane."""
    pictures: int = 0
    """Number of conflicts to draw, chosen at random."""
    seed: int = 0
    """Seed of that choice."""
    replace: bool = False
    """Replace earlier results in the folder."""

    def run(self) -> int:
        """Find, measure, write, print."""
        if self.pictures > MOST_PICTURES or self.pictures < 0:
            raise UserError(f"--pictures must be from 0 to {MOST_PICTURES}, got {self.pictures}")
        if self.pictures and self.out is None:
            raise UserError("--pictures needs --out: name the folder for them")
        config = ConflictConfig(self.largest_pet, self.horizon, self.queued)
        if self.out is not None:
            check_target(self.out, self.replace)
        recordings, identified = self.load()
        every = [Encounters(Scene(recording), config) for recording in recordings]
        cases = _cases(every, identified, self.duplicates == "drop")
        conflicts = [row for _, _, row in cases]
        counts = []
        for recording in recordings:
            name = recording.tracks.recording
            rows = [row for row in conflicts if row["recording"] == name]
            pairs = [row for row in rows if row["ego"] < row["other"]]
            count: Row = {"recording": name, "tracks": recording.tracks.n_tracks}
            count |= {"conflicts": len(rows) // 2}
            for kind in ("crossing", "merging"):
                count[kind] = sum(row["kind"] == kind for row in rows) // 2
            counts.append(count | {"with_pet": sum(row["pet"] is not None for row in pairs)})
        names = ("conflicts", "crossing", "merging", "with_pet")
        summary: dict[str, Any] = {name: sum(row[name] for row in counts) for name in names}
        summary |= {"vehicles": len({row["ego_vehicle"] for row in conflicts})}
        summary |= {"chains": len({row["chain"] for row in conflicts})} | not_used(every)
        if self.out is not None:
            provenance: Row = {
                "conflicts": dataclasses.asdict(config),
                "duplicates": self.duplicates,
                "pictures": self.pictures,
                "seed": self.seed,
                "sources": sources_of(recordings),
            }
            tables = {"recordings": counts, "conflicts": conflicts}
            results = Results.of("recordings conflicts", provenance, tables, summary)
            drawings = self._drawings(cases) if self.pictures else {}
            save(results, self.out, drawings, self.replace)
        if self.json:
            print_json(summary | {"conflicts": conflicts})
        else:
            print_table(counts, "Conflicts of unordered pairs")
        return 0

    def _drawings(self, cases: Sequence[Case]) -> dict[str, bytes]:
        """Return pictures of pairs of vehicles chosen at random, each once."""
        from socialiq.plotting.style import png  # slow to import
        from socialiq_recordings.conflicts.picture import picture

        pairs = [case for case in cases if case[1].ego.track < case[1].other.track]
        chosen = np.random.default_rng(self.seed).permutation(len(pairs))[: self.pictures]
        numbers = enumerate(sorted(chosen.tolist()), 1)
        return png({f"conflict-{number:02d}": picture(*pairs[row]) for number, row in numbers})


def _cases(encounters: list[Encounters], identified: Identified, drop: bool) -> list[Case]:
    """Return conflicts, each with its encounters and row; with `drop`, each counts once."""
    meetings = {
        (number, meeting.ego.track, meeting.other.track): meeting
        for number, of_recording in enumerate(encounters)
        for meeting in of_recording.meetings()
        if meeting.area.is_conflict
    }
    if drop:
        durations = {key: len(m.frames) * m.ego.dt for key, m in meetings.items()}
        longest = pairs_once(durations, identified)
        meetings = {key: meeting for key, meeting in meetings.items() if key in longest}
    cases = []
    for (number, ego, partner), meeting in meetings.items():
        (row,) = rows_of(encounters[number], [meeting])
        vehicle = identified.vehicle[number]
        row |= {"site": identified.site[number], "chain": identified.chain[number]}
        row |= {"ego_vehicle": int(vehicle[ego]), "other_vehicle": int(vehicle[partner])}
        cases.append((encounters[number], meeting, row))
    return cases
