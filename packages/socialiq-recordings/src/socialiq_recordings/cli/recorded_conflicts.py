"""`data conflicts`: conflicts of recorded vehicles, their measures, and influence with a reason."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError
from socialiq.plotting.style import png
from socialiq.types import Row
from socialiq_lab.results import Results, check_target, save
from socialiq_recordings.cli.recorded_files import Choices, Swap, sources_of, swap_all
from socialiq_recordings.conflicts import pictures, rules
from socialiq_recordings.conflicts.config import ConflictConfig
from socialiq_recordings.conflicts.moments import moments_of
from socialiq_recordings.conflicts.pairs import Encounters, Meeting
from socialiq_recordings.conflicts.table import rows_of
from socialiq_recordings.episodes.ego_swap import Swapped
from socialiq_recordings.episodes.scene import Scene
from socialiq_recordings.identity.identify import Identified
from socialiq_recordings.identity.once import pairs_once

_Choices = tyro.conf.OmitArgPrefixes[Choices]
MOST_PICTURES = 200
"""Largest number of pictures of a call."""


@dataclass(frozen=True)
class FindConflicts:
    """List conflicts of recorded vehicles with PET, TTC, gaps and required decelerations.

    Example: socialiq data conflicts junction.safetensors --out conflicts --pictures 20
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    out: Path | None = None
    """Folder to write: conflicts, moments, charged brakings, rules of influence, pictures."""
    choices: _Choices = dataclasses.field(default_factory=Choices)
    largest_pet: float = ConflictConfig.near
    """Seconds between two vehicles in an area above which they are in no conflict."""
    horizon: float = ConflictConfig.horizon
    """Seconds ahead in which both must arrive at their present speeds."""
    queued: bool = False
    """Also list conflicts of vehicles that are behind others of their lane."""
    changed: float = ConflictConfig.changed
    """Smallest loss of speed, m/s, that the counterfactual must make."""
    pictures: int = 0
    """Number of conflicts to draw, chosen at random."""
    seed: int = 0
    """Seed of that choice."""
    replace: bool = False
    """Replace earlier results in the folder."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Find, measure, write, print."""
        if self.pictures > MOST_PICTURES or self.pictures < 0:
            raise UserError(f"--pictures must be from 0 to {MOST_PICTURES}, got {self.pictures}")
        if self.pictures and self.out is None:
            raise UserError("--pictures needs --out: name the folder for them")
        config = ConflictConfig(self.largest_pet, self.horizon, self.queued, changed=self.changed)
        if self.out is not None:
            check_target(self.out, self.replace)
        swap = swap_all(self.recordings, self.choices, self.json)
        found = _find(swap, config, self.choices)
        if self.out is not None:
            drawn = found.drawn(self.pictures, self.seed)
            asked = _Asked(self.choices, config, self.pictures, self.seed, sources_of(swap.swapped))
            results = Results.of("recordings conflicts", asked, found.tables, found.summary)
            save(results, self.out, drawn, self.replace)
        if self.json:
            print_json(found.summary | {"conflicts": found.tables["conflicts"]})
        else:
            print_table(found.tables["recordings"], "Conflicts of unordered pairs")
            print_table(found.tables["rules"], "\nBrakings charged to egos, by rule")
        return 0


@dataclass(frozen=True)
class _Asked:
    """Provenance of the conflicts."""

    choices: Choices
    conflicts: ConflictConfig
    pictures: int
    seed: int
    sources: list[dict[str, Any]]


@dataclass(frozen=True, eq=False)
class _Found:
    """Conflicts of some recordings.

    Attributes:
        tables: Rows by table name.
        summary: Counts of the conflicts, and the rules.
        places: Each conflict, with the encounters of its recording and its row.
    """

    tables: dict[str, list[Row]]
    summary: dict[str, Any]
    places: list[tuple[Encounters, Meeting, Row]]

    def drawn(self, count: int, seed: int) -> Mapping[str, bytes]:
        """Return pictures of conflicts drawn at random, by file name."""
        each = {id(meeting): (where, meeting, row) for where, meeting, row in self.places}
        chosen = pictures.drawn_at_random([one for _, one, _ in self.places], count, seed)
        return png(
            {
                f"conflict-{number:02d}": pictures.picture(*each[id(meeting)])
                for number, meeting in enumerate(chosen, 1)
            }
        )


def _find(swap: Swap, config: ConflictConfig, choices: Choices) -> _Found:
    tables: dict[str, list[Row]] = {
        name: [] for name in ("recordings", "conflicts", "moments", "brakings")
    }
    identified, every = swap.identified, [Encounters(Scene(one), config) for one in swap.recordings]
    places = []
    for place, kept in enumerate(_meetings(every, identified, choices.duplicates)):
        encounters, each = every[place], swap.swapped[place]
        rows = [
            row | _who(identified, place, one)
            for row, one in zip(rows_of(encounters, kept), kept, strict=True)
        ]
        places += [(encounters, *one) for one in zip(kept, rows, strict=True)]
        moments = [
            row | _who(identified, place, kept[row["conflict"]])
            for row in moments_of(encounters, kept, 1 / choices.policy_rate)
        ]
        tables["recordings"].append(_counts(each, rows, moments))
        tables["conflicts"] += rows
        tables["moments"] += moments
        tables["brakings"] += rules.brakings(encounters, each, each.config)
    tables["rules"] = rules.summary(tables["brakings"])
    count = {
        name: sum(row[name] for row in tables["recordings"])
        for name in ("conflicts", "crossing", "merging", "with_pet", "moments")
    }
    vehicles = {row["ego_vehicle"] for row in tables["conflicts"]}
    chains = {row["chain"] for row in tables["conflicts"]}
    summary = count | {"vehicles": len(vehicles), "chains": len(chains), "rules": tables["rules"]}
    return _Found(tables, summary, places)


def _meetings(
    every: list[Encounters], identified: Identified, duplicates: str
) -> list[list[Meeting]]:
    """Return the conflicts of each recording, those that two recordings show once."""
    found = [encounters.meetings() for encounters in every]
    if duplicates != "drop":
        return found
    sizes = {
        (place, one.ego.track, one.other.track): len(one.frames) * one.ego.dt
        for place, meetings in enumerate(found)
        for one in meetings
    }
    kept = pairs_once(sizes, identified)
    return [
        [one for one in meetings if (place, one.ego.track, one.other.track) in kept]
        for place, meetings in enumerate(found)
    ]


def _who(identified: Identified, place: int, meeting: Meeting) -> Row:
    """Return site, chain and vehicles of a conflict, by which data are split and resampled."""
    vehicle = identified.vehicle[place]
    return {
        "site": identified.site[place],
        "chain": identified.chain[place],
        "ego_vehicle": int(vehicle[meeting.ego.track]),
        "other_vehicle": int(vehicle[meeting.other.track]),
    }


def _counts(swapped: Swapped, rows: list[Row], moments: list[Row]) -> Row:
    pairs = [row for row in rows if row["ego"] < row["other"]]
    return {
        "recording": swapped.recording,
        "tracks": swapped.n_tracks,
        "conflicts": len(rows) // 2,
        "crossing": sum(row["kind"] == "crossing" for row in rows) // 2,
        "merging": sum(row["kind"] == "merging" for row in rows) // 2,
        "with_pet": sum(row["pet"] is not None for row in pairs),
        "moments": len(moments),
    }
