"""Our methods with discrete actions: dials and IQ-Learn, in a Gymnasium environment."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from gymnasium import spaces

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.acting import Driver
from socialiq.learners.collect import Behaviour, Collector, from_env
from socialiq.learners.dial import train as dials
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.objective import Networks
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import train as iq_learn
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Act
from socialiq.worlds.environment import sizes
from studies.mo_gymnasium.tasks import Task

ROUND = 100
"""Steps, and as many updates, before a learner acts with its newer network."""

NUMBERS = DialHyperparameters(temperature=0.01)
"""Numbers of the dials; chosen on training seeds 100 and 101."""

LAST_EXPLORATION = 0.2
"""Share of random actions in the second half of a training; it falls from 1 in the first half."""

TRIO = iq.IQLearnHyperparameters(learning_rate=1e-3, temperature=0.1, prior_weight=5.0)
"""Numbers of IQ-Learn; tried on training seed 100, not tuned."""


def structure(task: Task, steps: int, demonstrated: bool) -> DialConfig:
    """Return the static config of a dial that takes these steps, one update for each."""
    space = task.make().observation_space
    assert isinstance(space, spaces.Box)  # of others no environment is made
    batch_size = task.batch_size // 2 if demonstrated else task.batch_size
    return DialConfig(
        demonstrations=demonstrated,
        backup="double",
        hidden=task.hidden,
        one_hot=one_hot(space.low, space.high) if task.exact else (),
        expert_batch=task.batch_size // 2,
        replay_batch=batch_size,
        updates=steps,
        replay_capacity=steps,
        environments=1,
        endings=iq.Endings(timeout="bootstrap"),
    )


def one_hot(low: np.ndarray, high: np.ndarray) -> tuple[tuple[int, int], ...]:
    """Return the smallest value and the number of values of each whole number observed."""
    return tuple((int(least), int(most - least) + 1) for least, most in zip(low, high, strict=True))


def exploring(static: DialConfig, numbers: Sequence[DialHyperparameters]) -> Behaviour:
    """Return how runs act: at an angle for each round, with fewer and fewer random actions."""

    def behaviour(networks: Networks, run: int, done: int, rng: np.random.Generator) -> Act:
        share = max(LAST_EXPLORATION, 1.0 - 2.0 * done / static.updates)
        own_numbers = dataclasses.replace(numbers[run], exploration=share)
        return Driver(static, own_numbers, networks.values, rng)

    return behaviour


def train_dials(
    task: Task,
    steps: int,
    seeds: Sequence[int],
    datasets: Sequence[Demonstrations] = (),
    only: float | None = None,
) -> list[DialPolicy]:
    """Train a dial for each seed, online.

    Args:
        task: Where it acts.
        steps: In the environment, and gradient steps.
        seeds: Training seeds.
        datasets: Demonstrations for each seed; none for a dial that learns from its rewards alone.
        only: The one angle to train for, in degrees; by default all from 0 to 90.
    """
    static = structure(task, steps, bool(datasets))
    if only is not None:
        static = dataclasses.replace(static, low=only, high=only, margin=0.0)
    numbers = [
        dataclasses.replace(
            NUMBERS, seed=seed, discount=task.discount, dataset=number * bool(datasets)
        )
        for number, seed in enumerate(seeds)
    ]
    sources = [from_env(task.make(), ROUND, goes_on=True) for _ in seeds]
    collect = Collector(sources, list(seeds), exploring(static, numbers))
    trained = dials.train(
        static, numbers, list(datasets), None, sizes(task.make()), chunk=ROUND, before_chunk=collect
    )
    return [trained.policy(run) for run in range(len(seeds))]


def train_trio(
    task: Task, datasets: Sequence[Demonstrations], seeds: Sequence[int], angles: Sequence[float]
) -> list[list[QPolicy]]:
    """Train IQ-Learn offline at each angle on the demonstrations of each seed.

    Returns:
        For each seed the policy of each angle.
    """
    static = iq.IQLearnConfig(
        prior="shifted_chi2",
        target_kind="instantaneous",
        value_term="value_expert",
        online=False,
        hidden=task.hidden,
        batch_size=task.batch_size,
        updates=5000,
        endings=iq.Endings(timeout="bootstrap"),
    )
    numbers = [
        dataclasses.replace(TRIO, seed=seed, angle=angle, dataset=number, discount=task.discount)
        for number, seed in enumerate(seeds)
        for angle in angles
    ]
    trained = iq_learn.train(static, numbers, list(datasets))
    policies = [trained.policy(run) for run in range(len(numbers))]
    return [policies[first : first + len(angles)] for first in range(0, len(policies), len(angles))]
