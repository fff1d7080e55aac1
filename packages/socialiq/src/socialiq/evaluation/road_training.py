"""Training on the roads of highway-env: experience of runs, checks, and labels by rollouts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from socialiq.errors import UserError
from socialiq.evaluation.branching import Branching
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.parts import available_cores
from socialiq.learners.acting import dials, dials_together, soft
from socialiq.learners.collect import (
    BaseCollector,
    Collector,
    Source,
    VectorCollector,
    from_vector_env,
)
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.rows import stratified_angles
from socialiq.learners.iq_learn.config import IQLearnHyperparameters
from socialiq.learners.policy_iteration import DialIterationConfig, IterationHyperparameters
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import Policy
from socialiq.worlds.highway.gym import RoadVectorEnv
from socialiq.worlds.highway.world import SceneWorld
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.gym import intersections
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

CHUNK = 200  # updates between two rounds of acting


STEPS_PER_UPDATE = 12
"""Rows of experience that a dial takes in for each update."""


MEASURES = ("total", "collision", "arrival", "timeout", "r_env", "r_social")
"""Measures of a check; `total` is J(α), the mean total scored at the run's own angle."""


ITERATION = DialIterationConfig(
    batch_size=512,
    updates=20_000,
    states_per_update=40,
    first_rounds=10,
    replay_capacity=400_000,
)
"""Static config that improves dials of the intersection's preset; the network is the dial's."""


ITERATION_NUMBERS = IterationHyperparameters(
    learning_rate=1e-3, regression=0.0, exploration_fall=1e-6
)
"""Hyperparameters beside it."""


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
    numbers: Sequence[IQLearnHyperparameters],
) -> Collector:
    """Return what collects experience of softmax policies, from intersections of each run."""
    sources = [source_of(options, environments, steps_per_update) for _ in numbers]
    behaviour = soft([one.temperature for one in numbers])
    return Collector(sources, [one.seed for one in numbers], behaviour)


def dial_collector(
    structure: DialConfig,
    numbers: Sequence[DialHyperparameters],
    world: Intersection | SceneWorld,
    environments: int,
    steps_per_update: int,
) -> BaseCollector:
    """Return what collects dials' experience on the core, from episodes of each run.

    Several runs act together, on as many threads as there are runs, or cores if fewer.

    Args:
        structure: Shared by all runs; with a clock where times are redrawn.
        numbers: Of each run.
        world: The road.
        environments: Episodes side by side, of each run.
        steps_per_update: Rows for each update.
    """
    clock, count = structure.redraw_times > 0, len(numbers)
    if count == 1:
        source = road_source(world, environments, steps_per_update, clock)
        return Collector(
            [source], [numbers[0].seed], dials(structure, numbers), structure.driven_share > 0
        )
    batch = world.batch(count * environments, min(count, available_cores()))
    env = RoadVectorEnv(world, batch, 0.0, AutoresetMode.SAME_STEP, clock)
    rounds = -(-CHUNK * steps_per_update // environments)
    return VectorCollector(env, rounds, numbers, dials_together(structure, numbers))


def observes_time(start: DialPolicy, options: Options) -> bool:
    """Whether a dial of the intersection observes the time.

    Raises:
        UserError: If it is of another world.
    """
    (n_features, n_actions) = sizes_of(options)
    if start.n_actions != n_actions or start.n_features not in (n_features, n_features + 1):
        raise UserError(
            f"this dial takes {start.n_features} features and has {start.n_actions} actions: "
            "give one of the intersection"
        )
    return start.n_features > n_features


def dial_labeller(
    structure: DialIterationConfig, options: Options, environments: int, clock: bool
) -> Branching:
    """Return the labeller of one run, whose episodes have angles of their own."""

    def angles(count: int, rng: np.random.Generator) -> np.ndarray:
        return stratified_angles(structure, count, rng)

    states = CHUNK * structure.states_per_update
    return Branching(options, states, environments, clock, angles)
