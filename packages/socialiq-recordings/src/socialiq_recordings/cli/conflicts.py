"""`data conflicts`: conflicts of recorded road users, their measures, and pictures of them."""

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
from socialiq_recordings.cli.files import OfDistinct, sources_of, users_used
from socialiq_recordings.conflicts.encounters import ConflictConfig, Encounters, Meeting
from socialiq_recordings.conflicts.measures import UNAVOIDABLE, rows_of
from socialiq_recordings.conflicts.walking import pedestrians
from socialiq_recordings.conflicts.yielding import (
    Weight,
    group_of,
    recovered,
    stakes_of,
    weight,
    who_yields,
)
from socialiq_recordings.identity.identify import Identified, pairs_once
from socialiq_recordings.recording import Tracks
from socialiq_recordings.road.routes import Scene

Case = tuple[Encounters, Meeting, Row]

_KINDS = ("crossing", "merging", "head_on")
MOST_PICTURES = 200  # largest number of pictures of a call


@dataclass(frozen=True)
class FindConflicts(OfDistinct):
    """List conflicts of recorded road users with PET, TTC, gaps and required decelerations.

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
        recordings, identified = self.load(lanelets=False)
        every = [Encounters(Scene(recording), config, everybody=True) for recording in recordings]
        cases = _cases(every, identified, self.duplicates == "drop")
        conflicts = [row for _, _, row in cases]
        counts = [_count(recording.tracks, conflicts) for recording in recordings]
        names = ("conflicts", *_KINDS, "with_pet", UNAVOIDABLE)
        summary: dict[str, Any] = {name: sum(row[name] for row in counts) for name in names}
        summary |= {"vehicles": len({row["ego_vehicle"] for row in conflicts})}
        summary |= {"chains": len({row["chain"] for row in conflicts})}
        every_track = [recording.tracks for recording in recordings]
        users = users_used(every_track, [encounters.ways for encounters in every])
        yields = who_yields(conflicts)
        weights = _weights(cases, self.seed)
        walkers = pedestrians(recordings, conflicts)
        summary |= {"road_users": users, "yielding": yields, "weights": weights}
        summary |= {"pedestrians": walkers}
        if self.out is not None:
            provenance: Row = {
                "conflicts": dataclasses.asdict(config),
                "duplicates": self.duplicates,
                "pictures": self.pictures,
                "seed": self.seed,
                "sources": sources_of(recordings),
            }
            tables = {"recordings": counts, "conflicts": conflicts, "road_users": users}
            tables |= {"yielding": yields, "weights": weights, "pedestrians": walkers}
            tables = {name: rows for name, rows in tables.items() if rows}
            results = Results.of("recordings conflicts", provenance, tables, summary)
            drawings = self._drawings(cases) if self.pictures else {}
            save(results, self.out, drawings, self.replace)
        if self.json:
            print_json(summary | {"conflicts": conflicts})
        else:
            print_table(counts, "Conflicts of unordered pairs")
            print_table(users, "Road users")
            titles = ("Who yields to whom", "Weight shown", "Pedestrians")
            for title, rows in zip(titles, (yields, weights, walkers), strict=True):
                if rows:
                    cells = [{n: "" if v is None else v for n, v in r.items()} for r in rows]
                    print_table(cells, title)
        return 0

    def _drawings(self, cases: Sequence[Case]) -> dict[str, bytes]:
        """Return pictures of pairs of vehicles chosen at random, each once."""
        from socialiq.plotting.style import png  # slow to import
        from socialiq_recordings.conflicts.picture import picture

        pairs = [case for case in cases if case[1].ego.track < case[1].other.track]
        chosen = np.random.default_rng(self.seed).permutation(len(pairs))[: self.pictures]
        numbers = enumerate(sorted(chosen.tolist()), 1)
        return png({f"conflict-{number:02d}": picture(*pairs[row]) for number, row in numbers})


def _count(tracks: Tracks, conflicts: Sequence[Row]) -> Row:
    """Return the numbers of road users and of conflicts of a recording."""
    rows = [row for row in conflicts if row["recording"] == tracks.recording]
    pairs = [row for row in rows if row["ego"] < row["other"]]
    count: Row = {"recording": tracks.recording, "tracks": tracks.n_tracks}
    count |= {"conflicts": len(rows) // 2}
    for kind in _KINDS:
        count[kind] = sum(row["kind"] == kind for row in rows) // 2
    count["with_pet"] = sum(row["pet"] is not None for row in pairs)
    needed = [(row["required_deceleration"], row["other_required_deceleration"]) for row in pairs]
    return count | {UNAVOIDABLE: sum(UNAVOIDABLE in both for both in needed)}


def _weights(cases: Sequence[Case], seed: int) -> list[Row]:
    """Return the weights of each group's time that those of another show, and what is recovered.

    Rows with a true angle have the range of estimates where it is true, with recorded stakes.
    """
    rows: list[Row] = []
    for of, to in (("vehicle", "pedestrian"), ("bicycle", "pedestrian"), ("vehicle", "bicycle")):
        chosen = [
            (stakes, row["chain"])
            for _, meeting, row in cases
            if (group_of(row["ego_class"]), group_of(row["other_class"])) == (of, to)
            and (stakes := stakes_of(meeting)) is not None
        ]
        if not chosen:
            continue
        stakes, chains = zip(*chosen, strict=True)
        estimate = weight(stakes, np.unique(chains, return_inverse=True)[1], seed)
        row: Row = {"of": of, "to": to, "conflicts": len(chosen), "chains": len({*chains})}
        row["contested"] = sum(pair.contested for pair in stakes)
        none = dict.fromkeys(Weight._fields)
        rows.append(row | {"true": None} | (estimate._asdict() if estimate else none))
        sharpness = estimate.sharpness if estimate else 1.0
        for angle, low, high in recovered(stakes, sharpness, seed) if row["contested"] else ():
            ends = {"angle": None, "low": low, "high": high, "sharpness": sharpness}
            rows.append(row | {"true": angle} | ends)
    return rows


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
