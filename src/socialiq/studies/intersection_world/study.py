"""The intersection under rule-based drivers, and the rewards of each variant (thesis 5.1.3)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq.evaluation.play import Episodes, episodes_of
from socialiq.experiments.intersection.rows import outcome_row, reward_row
from socialiq.experiments.study import Context, Findings, StageCallback, counter
from socialiq.experiments.tables import nested
from socialiq.types import Row
from socialiq.worlds.intersection.batch import BackEnd
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import make

BATCH: dict[BackEnd, int] = {"core": 1024, "highway_env": 4}

POPULATIONS = ("highway_env", "thesis")
DRIVERS = ("go", "idle", "wait", "stop_line", "gap_2s", "gap_3s", "gap_4s", "random")
READING_DRIVERS = ("go", "wait", "random", "stop_line", "gap_3s")
READINGS: tuple[dict[str, Any], ...] = (
    {},
    {"zone": "last_8_m"},
    {"zone": "beyond_8_m"},
    {"zone": "travelled_8_m"},
    {"counted": "cross"},
    {"counted": "approaching"},
    {"disruption": "literal"},
    {"crash": "add"},
    {"neighbour_collision_weight": 0.0},
    {"progress_unit": 9.0},
    {"progress_unit": 30.0},
    {"progress_unit": 100.0},
    {"connected_lanes": True},
    {"canonical": True},
    {"population": "thesis"},
)


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (1_000_000,)
    """Seed of the first episode; the others follow. Also the random driver's."""
    episodes: int = 50_000
    """For the outcome rates, of each driver and population."""
    reading_episodes: int = 5_000
    """For each reading of the reward and driver."""
    threads: int = 1
    """Threads that share the episodes; nothing depends on it, and beside other work one is best."""
    back_end: BackEnd = "core"
    """core, or highway_env for the real one, which takes hundreds of times as long."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Drive, count and compute_tables."""
    outcomes = [
        {"population": population, "driver": driver} | outcome_row(episodes)
        for (population, driver), episodes in _driven(config, context.on_stage)
    ]
    readings = [
        {"reading": reading, "driver": driver} | reward_row(episodes)
        for (reading, driver), episodes in _read(config, context.on_stage)
    ]
    tables = {"outcomes": outcomes, "readings": readings}
    summary = _summary(outcomes, readings) | {"start": start_row(config)}
    return Findings(tables, summary)


Cells = list[tuple[tuple[str, str], dict[str, Any]]]


def _driven(config: Config, on_stage: StageCallback) -> Iterator[tuple[tuple[str, str], Episodes]]:
    cells: Cells = [
        ((population, driver), {"population": population})
        for population in POPULATIONS
        for driver in DRIVERS
    ]
    yield from _cells(cells, config.episodes, config, on_stage, "outcomes")


def _read(config: Config, on_stage: StageCallback) -> Iterator[tuple[tuple[str, str], Episodes]]:
    cells: Cells = [
        ((_name(reading), driver), reading) for reading in READINGS for driver in READING_DRIVERS
    ]
    episodes = min(config.reading_episodes, config.episodes)
    yield from _cells(cells, episodes, config, on_stage, "readings")


def _cells(
    cells: Cells, episodes: int, config: Config, on_stage: StageCallback, stage: str
) -> Iterator[tuple[tuple[str, str], Episodes]]:
    """Play every cell of a table, telling how far it is."""
    count = counter(on_stage, stage, len(cells) * episodes, "episodes")
    first = config.seeds[0]
    for number, (key, options) in enumerate(cells, start=1):
        seeds = range(first, first + episodes)
        yield key, drive(options, key[1], seeds, config.threads, config.back_end)
        count(number * episodes)


def drive(
    options: Mapping[str, Any],
    driver: str,
    seeds: Sequence[int],
    threads: int = 1,
    back_end: BackEnd = "core",
) -> Episodes:
    """One episode of a reference driver for each seed.

    Args:
        options: Fields of the intersection's `Options`.
        driver: Its name; the random one draws from the first seed.
        seeds: Of the episodes.
        threads: Threads that share them.
        back_end: "core" or "highway_env".
    """
    size = min(BATCH[back_end], len(seeds))
    batch = make(Options(**options)).batch(size, threads, back_end)
    return episodes_of(batch, policy(driver, seeds[0]), seeds)


def _name(reading: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in reading.items()) or "default"


def start_row(config: Config) -> Row:
    """Vehicles at the beginning of an episode, the ego included, and the ego's progress."""
    count, first = config.reading_episodes, config.seeds[0]
    batch = make(Options()).batch(count, config.threads)
    batch.reset(np.arange(first, first + count))
    present, began = batch.buffers.episodes["vehicles"], batch.buffers.episodes["start"]
    return {
        "episodes": count,
        "vehicles_mean": float(present.mean()),
        "vehicles_least": int(present.min()),
        "vehicles_most": int(present.max()),
        "share_with_five": float((present == 5).mean()),
        "ego_metres_least": float(began.min()),
        "ego_metres_mean": float(began.mean()),
    }


def _summary(outcomes: list[Row], readings: list[Row]) -> dict[str, Any]:
    options = dataclasses.asdict(Options())
    return {
        "outcomes": nested(outcomes, "population", "driver"),
        "default_reading": nested(readings, "reading", "driver")["default"],
        "options": options,
        "features": make(Options()).n_features,
        "actions": make(Options()).n_actions,
    }
