"""Training on the roads of highway-env: experience of runs, checks, and labels by rollouts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.branching import (
    branched_fleet_returns,
    branched_returns,
    observed,
)
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.parts import available_cores
from socialiq.learners import acting, collect, policy_iteration
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.rows import stratified_angles
from socialiq.learners.iq_learn.config import IQLearnHyperparameters
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import Act, Policy
from socialiq.worlds.grammar import road_of
from socialiq.worlds.gym import learning_env
from socialiq.worlds.highway.perception import EXITS, KNOWN
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

CHUNK = 200  # updates between two rounds of acting

STEPS_PER_UPDATE = 12
"""Rows of experience that a dial takes in for each update."""

MEASURES = ("total", "collision", "arrival", "timeout", "r_env", "r_social")
"""Measures of a check; `total` is J(α), the mean total scored at the run's own angle."""

ITERATION = policy_iteration.DialIterationConfig(
    batch_size=512,
    updates=20_000,
    states_per_update=40,
    first_rounds=10,
    replay_capacity=400_000,
)
ITERATION_NUMBERS = policy_iteration.IterationHyperparameters(
    learning_rate=1e-3, regression=0.0, exploration_fall=1e-6
)
"""Settings that improve dials of the intersection's preset; the network is the dial's."""

# Chosen on training seed 100 (docs/worlds/intersection-crosswalk.md).
CROSSWALK = dataclasses.replace(
    ITERATION,
    classes=True,
    view="set_ahead",
    hidden=(128, 128),
    batch_size=256,
    updates=8_000,
    first_rounds=5,
    replay_capacity=150_000,
)
CROSSWALK_NUMBERS = dataclasses.replace(ITERATION_NUMBERS, regression=0.4)
"""Settings of a dial of two angles at the intersection with crosswalks, which begins with none."""

Monitor = Callable[[Any], dict[str, np.ndarray]]
"""Called with the `TrainState` after each chunk; values are each (1,)."""


@dataclass(frozen=True)
class Checks:
    """Checks of a run: how many, spread evenly to its end, and the seeded episodes of each."""

    times: int = 20
    episodes: int = 300
    first_seed: int = 5_000_000

    @property
    def seeds(self) -> np.ndarray:
        """Seed of each episode."""
        return np.arange(self.first_seed, self.first_seed + self.episodes)

    def batch(self, options: Options) -> Batch:
        """Return the intersections in which the episodes are driven."""
        return Intersection(options).batch(min(self.episodes, 256))

    def measured(self, options: Options, policy: Policy, angle: float) -> dict[str, float]:
        """Return `MEASURES` of greedy episodes.

        Args:
            options: Options of the intersection.
            policy: Policy that drives.
            angle: Angle at which the total is scored, degrees.
        """
        metrics = episodes_of(self.batch(options), policy, self.seeds).metrics()
        measures = {name: getattr(metrics, name) for name in MEASURES[1:]}
        return {"total": metrics.value(angle)} | measures

    def due(self, chunk: int, chunks: int) -> bool:
        """Whether a run is checked after a chunk of updates.

        Args:
            chunk: Number of the chunk, from 1.
            chunks: Number of chunks of the run.
        """
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
    """Return the number of features of an observation, and of actions.

    Args:
        options: Options of the intersection.
        clock: Whether observations end with the time, one feature more.
    """
    world = road_of(options)
    return world.n_features + clock, world.n_actions


def source_of(
    options: Options, environments: int, steps_per_update: int, clock: bool = False
) -> collect.Source:
    """Return experience of intersections on the core, side by side, for a chunk of updates.

    Args:
        options: Options of the intersection.
        environments: Number of episodes side by side.
        steps_per_update: Environment steps for each update.
        clock: Whether observations end with the time.
    """
    env = learning_env(road_of(options), environments, clock)
    return collect.from_vector_env(env, CHUNK * steps_per_update)


def soft_collector(
    options: Options,
    environments: int,
    steps_per_update: int,
    numbers: Sequence[IQLearnHyperparameters],
) -> collect.Collector:
    """Return a collector of experience of softmax policies, from intersections of each run.

    Args:
        options: Options of the intersection.
        environments: Number of episodes side by side, of each run.
        steps_per_update: Environment steps for each update.
        numbers: Hyperparameters of each run, with the temperature of its policy and its seed.
    """
    sources = [source_of(options, environments, steps_per_update) for _ in numbers]
    behaviour = acting.soft([run.temperature for run in numbers])
    return collect.Collector(sources, [run.seed for run in numbers], behaviour)


def dial_collector(
    structure: DialConfig,
    numbers: Sequence[DialHyperparameters],
    world: RoadWorld,
    environments: int,
    steps_per_update: int,
) -> collect.BaseCollector:
    """Return what collects dials' experience on the core, from episodes of each run.

    Several runs act together, on as many threads as there are runs, or cores if fewer.

    Args:
        structure: Shared by all runs; with a clock where times are redrawn.
        numbers: Of each run.
        world: The road.
        environments: Episodes side by side, of each run.
        steps_per_update: Rows for each update.
    """
    count = len(numbers)
    steps = CHUNK * steps_per_update
    clock = structure.redraw_times > 0
    threads = min(count, available_cores())
    env = learning_env(world, count * environments, clock, threads)
    if count > 1:
        together = acting.dials_together(structure, numbers)
        return collect.VectorCollector(env, -(-steps // environments), numbers, together)
    behaviour = acting.dials(structure, numbers)
    seeds = [numbers[0].seed]
    return collect.Collector(
        [collect.from_vector_env(env, steps)], seeds, behaviour, structure.driven_share > 0
    )


def observes_time(start: DialPolicy, options: Options) -> bool:
    """Whether a dial of the intersection observes the time.

    Args:
        start: The dial.
        options: Options of the intersection.

    Raises:
        UserError: If it belongs to another world.
    """
    (n_features, n_actions) = sizes_of(options)
    if start.n_actions != n_actions or start.n_features not in (n_features, n_features + 1):
        raise UserError(
            f"this dial takes {start.n_features} features and has {start.n_actions} actions: "
            "give one of the intersection"
        )
    return start.n_features > n_features


def of_crosswalks(
    structure: policy_iteration.DialIterationConfig, world: Any, environments: int
) -> tuple[policy_iteration.DialIterationConfig, policy_iteration.Labeller, tuple[int, int]]:
    """Return structure, labeller and sizes of a dial of two angles that observes the time.

    Args:
        structure: Structure of the iteration; the number of its times is replaced.
        world: Intersection with crosswalks.
        environments: Largest number of episodes side by side.

    Returns:
        The sizes are the numbers of features, the time included, and of actions.
    """
    structure = dataclasses.replace(structure, times=world.options.decisions)
    labeller = dial_labeller(structure, world.with_parts(), environments, clock=True)
    return structure, labeller, (world.n_features + 1, world.n_actions)


def dial_labeller(
    structure: policy_iteration.DialIterationConfig,
    world: RoadWorld,
    environments: int,
    clock: bool,
) -> policy_iteration.Labeller:
    """Return the labeller of one run in a world, each of whose episodes has its angle.

    Each call begins with new episodes; copies are driven at the angle of their episode.

    Args:
        structure: Structure of the iteration.
        world: The intersection.
        environments: Largest number of episodes side by side.
        clock: Whether observations end with the time, before the angle.

    Returns:
        A `policy_iteration.Labeller`. It returns the states of a chunk of updates, with the sums
        of rewards of each action.
    """
    states = CHUNK * structure.states_per_update
    batch: Any = world.batch(min(environments, states))

    def label(follow: Act, share: float, rng: np.random.Generator) -> policy_iteration.Labelled:
        return label_states(structure, batch, states, clock, (follow, share), rng)

    return label


def label_states(
    structure: policy_iteration.DialIterationConfig,
    batch: Any,
    states: int,
    clock: bool,
    policy: tuple[Act, float],
    rng: np.random.Generator,
) -> policy_iteration.Labelled:
    """Return labelled states of new episodes, each of which has its angle.

    Args:
        structure: Structure of the iteration.
        batch: Episodes of one vehicle, which begin again.
        states: Number of states.
        clock: Whether observations end with the time, before the angle.
        policy: Policy that copies follow, and the share of random actions with which it visits
            states.
        rng: Random numbers of the episodes and their angles.

    Returns:
        The states, with the sums of rewards of each action.
    """
    follow, share = policy
    visit = policy_iteration.exploring(follow, share, batch.n_actions, rng)
    batch.reset(rng.integers(2**63, size=batch.size, dtype=np.uint64))
    angles = drawn_angles(structure, batch.size, rng)
    labelled = []
    for _ in range(-(-states // batch.size)):
        observation = observed(batch, clock, angles)
        returns = branched_returns(batch, follow, clock, angles)
        labelled.append(policy_iteration.Labelled(observation, returns))
        batch.step(visit(observation))
    return jax.tree.map(lambda *columns: np.concatenate(columns)[:states], *labelled)


def drawn_angles(
    structure: policy_iteration.DialIterationConfig, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return angles of episodes in degrees, (count,); with classes both angles, (count, 2).

    Args:
        structure: Structure of the iteration.
        count: Number of episodes.
        rng: Random numbers.
    """
    angles = stratified_angles(structure, count, rng)
    if not structure.classes:
        return angles
    margin = structure.margin
    of_class = rng.uniform(-margin, 90.0 + margin, count)
    return np.column_stack([angles, of_class])


def shifted(
    structure: policy_iteration.DialIterationConfig,
    start: DialPolicy,
    shifts: Sequence[str],
    environments: int,
) -> tuple[DialPolicy, policy_iteration.DialIterationConfig, policy_iteration.Labeller]:
    """Return first dial, structure and labeller of a run over several worlds of shifts.

    The worlds share the states, the first ones with one more where they don't divide. Every episode
    draws one shift of its world, and drives behind a front end that knows it. The clock tells the
    exit.

    Args:
        structure: Structure of the iteration; its network becomes that of the dial.
        start: Dial of the intersection that observes the time.
        shifts: Descriptions of the worlds' shifts.
        environments: Number of episodes side by side, of all worlds together.

    Raises:
        UserError: If the dial does not observe the time or belongs to another world, or there are
            more worlds than states per update.
    """
    clock = observes_time(start, Options())
    share, remainder = divmod(structure.states_per_update, len(shifts))
    if not clock or share < 1:
        raise UserError(
            f"--shift needs a dial that observes the time, and at most "
            f"{structure.states_per_update} worlds (--set states_per_update)"
        )
    start = start.with_times(Options().decisions * len(EXITS))
    structure = policy_iteration.with_network_of(structure, start)
    worlds = [road_of().shifted(text, f"{KNOWN},exit=own") for text in shifts]
    beside = max(environments // len(worlds), 1)
    labellers = []
    for number, world in enumerate(worlds):
        states = share + (number < remainder)
        of_world = dataclasses.replace(structure, states_per_update=states)
        labellers.append(dial_labeller(of_world, world, beside, clock))

    def label(follow: Act, explored: float, rng: np.random.Generator) -> policy_iteration.Labelled:
        labelled = [labeller(follow, explored, rng) for labeller in labellers]
        return jax.tree.map(lambda *columns: np.concatenate(columns), *labelled)

    return start, structure, label


def fleet_labeller(
    structure: policy_iteration.DialIterationConfig,
    world: RoadWorld,
    environments: int,
    clock: bool,
) -> policy_iteration.Labeller:
    """Return the labeller of one run in fleets that its dial drives against itself.

    In every second fleet all agents have nearly the same angle, in the rest angles of the whole
    range. Of each fleet one agent's state is labelled: r_social is what all other agents get, the
    sum of their r_env. Between two actions of a state it differs by what the agent causes.

    Args:
        structure: Structure of the iteration.
        world: Road whose vehicles the fleet drives.
        environments: Largest number of fleets side by side.
        clock: Whether observations end with the time, before the angle.

    Returns:
        A function as `dial_labeller` returns it.
    """
    states = CHUNK * structure.states_per_update
    batch = world.batch(min(environments, states))

    def label(follow: Act, share: float, rng: np.random.Generator) -> policy_iteration.Labelled:
        return label_fleets(structure, batch, states, clock, (follow, share), rng)

    return label


def label_fleets(
    structure: policy_iteration.DialIterationConfig,
    batch: Any,
    states: int,
    clock: bool,
    policy: tuple[Act, float],
    rng: np.random.Generator,
) -> policy_iteration.Labelled:
    """Return labelled states of one agent of each of new fleets; see `fleet_labeller`.

    Args:
        structure: Structure of the iteration.
        batch: Fleets, which begin again.
        states: Number of states.
        clock: Whether observations end with the time, before the angle.
        policy: Policy that all agents of copies follow, and the share of random actions with which
            it visits states.
        rng: Random numbers of the fleets, their angles and the labelled agents.

    Returns:
        The states, with the sums of rewards of each action.
    """
    follow, share = policy
    visit = policy_iteration.exploring(follow, share, batch.n_actions, rng)
    batch.reset(rng.integers(2**63, size=batch.size, dtype=np.uint64))
    angles = drawn_angles(structure, math.prod(batch.shape), rng)
    angles = angles.reshape(*batch.shape, *angles.shape[1:])
    mixed = angles[1::2]
    angles[1::2] = rng.permutation(mixed.reshape(-1, *angles.shape[2:])).reshape(mixed.shape)
    labelled = []
    fleets = np.arange(batch.size)
    for _ in range(-(-states // batch.size)):
        observation = observed(batch, clock, angles).reshape(math.prod(batch.shape), -1)
        chosen = (batch.driving * rng.random(batch.shape)).argmax(axis=1)
        returns = branched_fleet_returns(batch, follow, clock, angles, chosen)
        rows = fleets * batch.shape[1] + chosen
        labelled.append(policy_iteration.Labelled(observation[rows], returns))
        batch.step(visit(observation).reshape(batch.shape))
    return jax.tree.map(lambda *columns: np.concatenate(columns)[:states], *labelled)
