"""`data conflicts`: conflicts of recorded vehicles and their measures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Printing, print_json, print_table
from socialiq.errors import UserError
from socialiq.plotting.style import png
from socialiq.results_folder import Results, check_target, save
from socialiq.types import Row
from socialiq_recordings.cli.files import load_identified, sources_of
from socialiq_recordings.conflicts import pictures
from socialiq_recordings.conflicts.encounters import ConflictConfig, Encounters, Meeting
from socialiq_recordings.conflicts.measures import rows_of
from socialiq_recordings.identity.duplicates import Duplicates, pairs_once
from socialiq_recordings.identity.identify import Identified
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.routes import Scene

MOST_PICTURES = 200
"""Largest number of pictures of a call."""


@dataclass(frozen=True)
class FindConflicts(Printing):
    """List conflicts of recorded vehicles with PET, TTC, gaps and required decelerations.

    Example: socialiq data conflicts junction.safetensors --out conflicts --pictures 20
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    out: Path | None = None
    """Folder to write: conflicts, counts by recording, pictures."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    duplicates: Duplicates = "drop"
    """Conflicts whose moments are in several recordings: count each once, keep all, or refuse."""
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
        recordings, identified = load_identified(
            self.recordings, self.road, self.duplicates, self.json
        )
        cases = _cases(recordings, identified, config, self.duplicates == "drop")
        conflicts = [row for _, _, row in cases]
        counts = [_counts(recording, conflicts) for recording in recordings]
        summary: dict[str, Any] = {
            name: sum(row[name] for row in counts)
            for name in ("conflicts", "crossing", "merging", "with_pet")
        }
        summary |= {
            "vehicles": len({row["ego_vehicle"] for row in conflicts}),
            "chains": len({row["chain"] for row in conflicts}),
        }
        if self.out is not None:
            drawings = self._drawings(cases)
            provenance = _Provenance(
                config, self.duplicates, self.pictures, self.seed, sources_of(recordings)
            )
            tables = {"recordings": counts, "conflicts": conflicts}
            results = Results.of("recordings conflicts", provenance, tables, summary)
            save(results, self.out, drawings, self.replace)
        if self.json:
            print_json(summary | {"conflicts": conflicts})
        else:
            print_table(counts, "Conflicts of unordered pairs")
        return 0

    def _drawings(self, cases: list[tuple[Encounters, Meeting, Row]]) -> dict[str, bytes]:
        """Return pictures of conflicts chosen at random, by file name."""
        case_of = {id(meeting): case for case in cases for meeting in case[1:2]}
        chosen = pictures.drawn_at_random([case[1] for case in cases], self.pictures, self.seed)
        return png(
            {
                f"conflict-{number:02d}": pictures.picture(*case_of[id(meeting)])
                for number, meeting in enumerate(chosen, 1)
            }
        )


@dataclass(frozen=True)
class _Provenance:
    """Provenance of the conflicts."""

    conflicts: ConflictConfig
    duplicates: str
    pictures: int
    seed: int
    sources: list[dict[str, Any]]


def _cases(
    recordings: list[Recording], identified: Identified, config: ConflictConfig, drop: bool
) -> list[tuple[Encounters, Meeting, Row]]:
    """Return each conflict with the encounters of its recording and its row.

    With `drop`, those that two recordings show count once.
    """
    encounters = [Encounters(Scene(recording), config) for recording in recordings]
    meetings = {
        (number, meeting.ego.track, meeting.other.track): meeting
        for number, of_recording in enumerate(encounters)
        for meeting in of_recording.meetings()
    }
    if drop:
        durations = {key: len(m.frames) * m.ego.dt for key, m in meetings.items()}
        longest = pairs_once(durations, identified)
        meetings = {key: meeting for key, meeting in meetings.items() if key in longest}
    cases = []
    for (number, ego, partner), meeting in meetings.items():
        (row,) = rows_of(encounters[number], [meeting])
        vehicle = identified.vehicle[number]
        row |= {
            "site": identified.site[number],
            "chain": identified.chain[number],
            "ego_vehicle": int(vehicle[ego]),
            "other_vehicle": int(vehicle[partner]),
        }
        cases.append((encounters[number], meeting, row))
    return cases


def _counts(recording: Recording, conflicts: list[Row]) -> Row:
    name = recording.tracks.recording
    rows = [row for row in conflicts if row["recording"] == name]
    pairs = [row for row in rows if row["ego"] < row["other"]]
    return {
        "recording": name,
        "tracks": recording.tracks.n_tracks,
        "conflicts": len(rows) // 2,
        "crossing": sum(row["kind"] == "crossing" for row in rows) // 2,
        "merging": sum(row["kind"] == "merging" for row in rows) // 2,
        "with_pet": sum(row["pet"] is not None for row in pairs),
    }
