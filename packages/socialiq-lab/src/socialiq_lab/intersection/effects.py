"""Effects of drivers: the job that drives them on common episodes, and rows over seeds."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from socialiq.cli.drivers import driver_of
from socialiq.evaluation.effects import COUNTS, measure, measuring
from socialiq.evaluation.measures import Episodes
from socialiq.types import Row
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.registry import make
from socialiq_lab.intersection.driving import DIAL
from socialiq_lab.jobs import Inputs, ProgressCallback
from socialiq_lab.tables import over_seeds

MEASURES = "measures.npy"
"""File of a job: (driver, shield, episode, measure)."""


@dataclass(frozen=True)
class EffectsRun:
    """Episodes of several drivers, on the same seeds."""

    drivers: tuple[str, ...]
    """Rules and policies of the atlas; or what is behind the input's dial, as "@45/60"."""
    measures: tuple[str, ...]
    """Columns or quantities of `evaluation.effects.measure`."""
    seeds: tuple[int, ...]
    world: str = "intersection"
    effects: EffectOptions | None = None
    """Options of what is caused; None for those of the world."""
    shields: tuple[float, ...] = (0.0,)
    """Times of the shields with which each driver drives, s; 0 for none."""


def measure_effects(
    config: EffectsRun, folder: Path, inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Drive every driver with every shield, and write the measures of its episodes.

    Args:
        config: Drivers, measures, episodes and world.
        folder: Folder of the job, to which the array is written.
        inputs: Folder of the job that makes the dial; empty without one.
        on_progress: Called with the share of the drivers that have driven.
    """
    options = asdict(config.effects) if config.effects else {}
    world = measuring(cast(RoadWorld, make(config.world)), **options)
    dials = [str(path) for trained in inputs.values() for path in trained.rglob(DIAL)]
    judging = any(name in COUNTS for name in config.measures)
    drive = partial(measure, world, seeds=config.seeds, begun={}, judging=judging)
    rows: list[list[np.ndarray]] = []
    for name in config.drivers:
        with driver_of(dials[0] + name if name.startswith("@") else name, world) as loaded:
            driven = [drive(policy=loaded.policy, shield=time) for time in config.shields]
        rows.append([measured(episodes, config.measures) for episodes in driven])
        on_progress(len(rows) / len(config.drivers))
    np.save(folder / MEASURES, np.array(rows))


def measured(episodes: Episodes, names: Sequence[str]) -> np.ndarray:
    """Return measures of each episode, (episode, measure).

    Args:
        episodes: Effects of a driver on its episodes.
        names: Names of columns or quantities. An episode in which a person is hit does not count
            as a `collision`.
    """
    hits = sum(column for name, column in episodes.items() if name.endswith("_hit"))
    vehicles = {"collision": episodes.collision & (hits == 0)}
    return np.column_stack([vehicles[n] if n in vehicles else episodes[n] for n in names])


def effects_row(names: Sequence[str], runs: Sequence[np.ndarray]) -> Row:
    """Return means over training seeds, intervals over episodes, and ranges over seeds.

    Args:
        names: Names of the first measures.
        runs: Measures of each training seed, (episode, measure).

    Returns:
        Numbers of seeds and episodes, and for each measure its mean and the suffixes `_low`,
        `_high`, `_least` and `_largest`.
    """
    row: Row = {"seeds": len(runs), "episodes": len(runs[0])}
    for column, name in enumerate(names):
        row |= over_seeds(name.removeprefix("signal_"), [run[:, column] for run in runs])
    return row


def effects_of(folder: Path) -> Any:
    """Return the measures of a job, (driver, shield, episode, measure)."""
    return np.load(folder / MEASURES)
