"""A dial at a recorded junction from recorded drivers alone, without and with practice.

Recorded drivers show few of the states that their dials get into. With practice the dials drive in
this world and learn again from what they met. All drivers drive the same episodes.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq import Ending
from socialiq.audit.evidence.outcomes import Outcomes
from socialiq.demonstrations import files
from socialiq.statistics.comparisons import paired_difference
from socialiq.storage import read_json
from socialiq.types import Row
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import over_seeds
from socialiq_recordings.world.recorded_world import RecordedWorld
from studies.recorded_junction_practice import work as junction
from studies.recorded_junction_practice.work import check, jobs

_SIDES = ("r_env", "r_social")
__all__ = ["check", "compute_tables", "jobs"]
CLONE = "clone: "  # beginning of the name of a clone, before its mixture's


def compute_tables(config: Any, context: Context) -> Findings:
    """Return a row for each driver and angle, and the turn of each mixture's dials.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        Tables `angles`, `turns`, `drivers`, `data` and `practice`, and the summary.
    """
    work = context.work
    angles: list[Row] = []
    turns: list[Row] = []
    drivers = [_row(name, [runs]) for name, runs in junction.driven(work / "drivers").items()]
    summary = {}
    for mixture in junction.MIXTURES:
        outcomes = junction.driven(work / "driven" / junction.slug(mixture))
        dials = {
            angle: [outcomes[f"dial {seed} {angle:g}"] for seed in config.seeds]
            for angle in config.angles
        }
        for angle, runs in dials.items():
            angles.append({"mixture": mixture, "asked": angle} | _row("dial", runs))
        clones = [outcomes[f"clone {seed}"] for seed in config.seeds]
        drivers.append(_row(CLONE + mixture, clones))
        turned = _turns(mixture, dials)
        turns += turned
        summary[mixture] = {row["reward"]: row["difference"] for row in turned}
    counts = files.load(work / "world" / junction.HUMAN).counts().items()
    world = RecordedWorld.load(work / "world" / junction.WORLD)
    about = {name: world.provenance[name] for name in ("vehicles", "egos", "closures")}
    tables = {
        "angles": angles,
        "turns": turns,
        "drivers": drivers,
        "data": [{"driver": name, "episodes": n, "decisions": rows} for name, (n, rows) in counts],
        "practice": read_json(
            work / "dials" / junction.slug(junction.PRACTISED) / junction.PRACTICE
        ),
    }
    return Findings(tables, {"world_sha256": world.sha256} | about | summary)


def _row(name: str, runs: Sequence[Outcomes]) -> Row:
    """Return means over episodes and seeds; intervals over episodes, ranges over seeds."""
    row: Row = {"driver": name}
    for column, side in enumerate(_SIDES):
        row |= over_seeds(side, [run.totals[:, column] for run in runs])
    shares = {
        name: [run.episodes[name] for run in runs]
        for name in ("arrival", "at_fault", "struck", "timeout")
    }
    shares["closed_line"] = [run.episodes.ending == Ending.OTHER for run in runs]
    return row | {name: float(np.mean(result)) for name, result in shares.items()}


def _turns(mixture: str, dials: dict[float, list[Outcomes]]) -> list[Row]:
    """Return the change of both rewards from the first angle to the last, paired by episode."""
    first, last = (list(dials.values())[end] for end in (0, -1))
    rows: list[Row] = []
    for column, side in enumerate(_SIDES):
        new, old = ([run.totals[:, column] for run in runs] for runs in (last, first))
        change = paired_difference(np.mean(new, axis=0), np.mean(old, axis=0))
        changes = [float(a.mean() - b.mean()) for a, b in zip(new, old, strict=True)]
        label = {"mixture": mixture, "reward": side, "difference": change.mean}
        ends = {"low": change.low, "high": change.high, "p": change.p}
        rows.append(label | ends | {"least": min(changes), "largest": max(changes)})
    return rows
