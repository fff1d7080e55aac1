"""Training of the driver: policy iteration of one dial of two angles over a mixture of worlds.

Each chunk of updates draws new worlds from the mixture, labels the states that the driver visits in
them by rollouts of every action, and adds them to the ring that the network is fitted to
(`learners.policy_iteration`).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import numpy as np

from socialiq.driver_training.mixture import world_of_seed
from socialiq.evaluation import road_training
from socialiq.evaluation.parts import Workers
from socialiq.learners import policy_iteration
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.kernel import Trained
from socialiq.learners.policy_iteration import (
    DialIterationConfig,
    IterationHyperparameters,
    Labelled,
    Labeller,
)
from socialiq.nn.class_dial import ClassDial
from socialiq.types import Act, ByClass, RewardPair
from socialiq.worlds import grammar
from socialiq.worlds.highway.observation import N_FEATURES

STRUCTURE = DialIterationConfig(
    view="set",
    classes=True,
    hidden=(128, 128),
    batch_size=256,
    updates=16_000,
    states_per_update=32,
    first_rounds=4,
    replay_capacity=160_000,
)
"""Choices that shape the training; the updates take about an hour of one core."""

NUMBERS = IterationHyperparameters(learning_rate=1e-3, regression=0.4, exploration_fall=1e-6)
"""Numbers of one run."""

SECOND_STAGE = replace(NUMBERS, learning_rate=5e-4, regression=0.0, exploration=0.05)
"""Numbers of a run that begins with a trained driver: its values rule out no action any more."""

N_ACTIONS = 5  # slower, idle, faster, lane left, lane right
SIZES = N_FEATURES, N_ACTIONS
"""Features of an observation, and actions."""

WORLDS = 8  # of a chunk of updates
ROUNDS = 20  # decisions of its episodes at which states are labelled
_EPISODES = 1  # stream of a seed's random numbers that draws episodes, not the world


def labeller(structure: DialIterationConfig, workers: Workers | None = None) -> Labeller:
    """Return the labeller of a run over the mixture.

    Args:
        structure: Structure of the iteration, with both angles.
        workers: Processes among which the worlds are split; None: this one.

    Returns:
        A `policy_iteration.Labeller`. It draws `WORLDS` worlds and returns equal shares of their
        states, a chunk of updates in all. The labels of a world depend on its seed alone, so they
        are the same for any number of workers.
    """
    chunk = road_training.CHUNK * structure.states_per_update
    states = -(-chunk // WORLDS)

    def label(follow: Act, share: float, rng: np.random.Generator) -> Labelled:
        seeds = rng.integers(2**63, size=WORLDS).tolist()
        label_one = partial(label_world_of_seed, structure, states, (follow, share))
        labelled = workers(label_one, seeds) if workers else list(map(label_one, seeds))
        return jax.tree.map(lambda *columns: np.concatenate(columns)[:chunk], *labelled)

    return label


def label_world_of_seed(
    structure: DialIterationConfig, states: int, policy: tuple[Act, float], seed: int
) -> Labelled:
    """Return labelled states of the world of training that a seed draws.

    Args:
        structure: Structure of the iteration, with both angles.
        states: Number of states.
        policy: Policy that copies follow, and its share of random actions.
        seed: Seed of the world, its episodes and their angles.
    """
    rng = np.random.default_rng([_EPISODES, seed])
    return label_world(structure, world_of_seed(seed), states, policy, rng)


def label_world(
    structure: DialIterationConfig,
    text: str,
    states: int,
    policy: tuple[Act, float],
    rng: np.random.Generator,
) -> Labelled:
    """Return labelled states of new episodes of a world.

    Args:
        structure: Structure of the iteration, with both angles.
        text: The world.
        states: Number of states.
        policy: Policy that copies follow, and the share of random actions with which it visits
            states.
        rng: Random numbers of the episodes and their angles.

    Returns:
        The states, with the sums of r_env and of both classes of r_social for each action. Without
        people the second class gets 0.
    """
    world: Any = grammar.build(text)
    is_fleet = world.agents > 1
    if world.walks and not is_fleet:
        world = world.with_parts()
    batch = world.batch(-(-states // ROUNDS))
    label: Any = road_training.label_fleets if is_fleet else road_training.label_states
    labelled = label(structure, batch, states, False, policy, rng)
    social = labelled.returns.social
    if not isinstance(social, ByClass):
        social = ByClass(social, np.zeros_like(social))
    return labelled._replace(returns=RewardPair(labelled.returns.env, social))


def train(
    structure: DialIterationConfig,
    runs: Sequence[IterationHyperparameters],
    callbacks: Callbacks | None = None,
    start: ClassDial | None = None,
    processes: int = 0,
) -> Trained:
    """Train a driver for each entry of `runs`, as `policy_iteration.train`.

    Args:
        structure: Choices that shape the training, of all runs.
        runs: Numbers of each run.
        callbacks: Progress, monitor, checkpoint.
        start: Driver that every run begins with, for a second stage; None: a new network.
        processes: Number of processes that label states; 0: this one. The result is the same.

    Returns:
        The trained runs.

    Raises:
        UserError: If there is no run, or `start` has another network.
        Stopped: On Ctrl-C.
    """
    with Workers(processes) if processes else nullcontext() as workers:
        labellers = [labeller(structure, workers)] * len(runs)
        chunk = road_training.CHUNK
        return policy_iteration.train(structure, runs, labellers, SIZES, callbacks, chunk, start)
