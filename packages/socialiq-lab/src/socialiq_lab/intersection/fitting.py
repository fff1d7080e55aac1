"""Common parts of the intersection's training jobs: experience from the core, checks, resuming."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from socialiq.evaluation.episodes import episodes_of
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Collector, Source, from_vector_env, soft
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.kernel import Trained
from socialiq.learners.state import History
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Policy, Row
from socialiq.worlds.highway.gym import RoadVectorEnv
from socialiq.worlds.highway.world import SceneWorld
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.gym import intersections
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.intersection.episodes import CURVE
from socialiq_lab.jobs import ProgressCallback
from socialiq_lab.results import as_csv

CHECKPOINT = "checkpoint.safetensors"
CHUNK = 200  # updates between two rounds of acting

MEASURES = ("total", "collision", "arrival", "timeout", "r_env", "r_social")
"""Measures of a check; `total` is J(α), the mean total scored at the run's own angle."""

Monitor = Callable[[Any], dict[str, np.ndarray]]
"""Called with the `TrainState` after each chunk; values are each (1,)."""


@dataclass(frozen=True)
class Checks:
    """Checks of a run, and their episodes.

    Attributes:
        times: Checks of a run, spread evenly; the last one at its end.
        episodes: Episodes of a check.
        first_seed: First seed of these episodes, the same ones at every check.
    """

    times: int = 20
    episodes: int = 300
    first_seed: int = 5_000_000

    @property
    def seeds(self) -> np.ndarray:
        """Seed of each episode."""
        return np.arange(self.first_seed, self.first_seed + self.episodes)

    def batch(self, options: Options) -> Batch:
        """Return the intersections in which the episodes are driven."""
        return Batch(options, min(self.episodes, 256))

    def measured(self, options: Options, policy: Policy, angle: float) -> dict[str, float]:
        """Return `MEASURES` of a policy's greedy episodes.

        Args:
            options: Scenario.
            policy: The policy.
            angle: α of `total`, in degrees.
        """
        metrics = episodes_of(self.batch(options), policy, self.seeds).metrics()
        found = {"total": metrics.value(angle)}
        return found | {name: getattr(metrics, name) for name in MEASURES[1:]}

    def due(self, chunk: int, chunks: int) -> bool:
        """Whether a run of so many chunks is checked after this one (from 1)."""
        return (chunk * self.times) // chunks > ((chunk - 1) * self.times) // chunks

    def monitor(
        self, updates: int, measure: Callable[[Any, int], Mapping[str, float]], *names: str
    ) -> Monitor:
        """Return a callback that measures where a check is due, and gives NaN elsewhere.

        Args:
            updates: Updates of the run.
            measure: Called with the `TrainState` and the number of updates that are done.
            *names: Names of the measured values.
        """
        chunks = math.ceil(updates / CHUNK)

        def after_chunk(state: Any) -> dict[str, np.ndarray]:
            done = int(state.optimiser.count[0])
            if not self.due(math.ceil(done / CHUNK), chunks):
                return {name: np.array([np.nan]) for name in names}
            return {name: np.array([value]) for name, value in measure(state, done).items()}

        return after_chunk


def fit(
    train: Callable[..., Trained],
    folder: Path,
    on_progress: ProgressCallback,
    files: Sequence[str],
    monitor: Monitor | None = None,
) -> None:
    """Train, from the checkpoint of an interrupted try if there is one, and write the outcome.

    Args:
        train: Trains, given `callbacks` and `chunk`.
        folder: Folder to fill.
        on_progress: Called with the share that is done.
        files: Name of the file of each run's policy.
        monitor: Measures for the learning curve; none is written without it.
    """
    checkpoint = folder / CHECKPOINT
    callbacks = Callbacks(
        lambda report: on_progress(report.done / report.total),
        monitor,
        checkpoint,
        checkpoint.is_file(),
    )
    trained = train(callbacks=callbacks, chunk=CHUNK)
    for run, file in enumerate(files):
        trained.policy(run).save(folder / file)
    if monitor is not None:
        write_atomically(folder / CURVE, as_csv(curve_rows(trained.history)))
    checkpoint.unlink(missing_ok=True)


def curve_rows(history: History) -> list[Row]:
    """Return the checked points of the first run: updates, loss terms, measured values."""
    arrays = {name: history.array(name)[:, 0] for name in history.values}
    return [
        {"updates": updates} | {name: rounded(float(array[i])) for name, array in arrays.items()}
        for i, updates in enumerate(history.updates)
        if np.isfinite(arrays["total"][i])
    ]


def sizes_of(options: Options, clock: bool = False) -> tuple[int, int]:
    """Return the number of features of an observation, with or without the time, and of actions."""
    world = Intersection(options)
    return world.n_features + clock, world.n_actions


def source_of(
    options: Options, environments: int, steps_per_update: int, clock: bool = False
) -> Source:
    """Return experience of intersections on the core, side by side, for a chunk of updates.

    Args:
        options: Scenario.
        environments: Episodes side by side.
        steps_per_update: Environment steps for each update.
        clock: Whether observations end with the time.
    """
    return from_vector_env(intersections(options, environments, clock), CHUNK * steps_per_update)


def road_source(
    world: Intersection | SceneWorld, environments: int, steps_per_update: int, clock: bool = False
) -> Source:
    """Return experience of any road, as `source_of` does of the intersection."""
    batch = world.batch(environments)
    env = RoadVectorEnv(world, batch, 0.0, AutoresetMode.SAME_STEP, clock)
    return from_vector_env(env, CHUNK * steps_per_update)


def soft_collector(
    options: Options,
    environments: int,
    steps_per_update: int,
    numbers: Sequence[iq.IQLearnHyperparameters],
) -> Collector:
    """Return what collects experience of softmax policies, from intersections of each run."""
    sources = [source_of(options, environments, steps_per_update) for _ in numbers]
    behaviour = soft([one.temperature for one in numbers])
    return Collector(sources, [one.seed for one in numbers], behaviour)
