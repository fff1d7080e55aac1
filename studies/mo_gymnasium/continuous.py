"""Our methods with continuous actions: dials and IQ-Learn, in a Gymnasium environment."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.acting import drawing
from socialiq.learners.collect import Collector, from_env
from socialiq.learners.continuous import config
from socialiq.learners.continuous.standardise import Standardisation, explored
from socialiq.learners.continuous.train import train
from socialiq.learners.kernel import Trained
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.worlds.environment import action_size, sizes
from studies.mo_gymnasium.tasks import Task

ROUND = 50
"""Steps, and as many updates, before a learner acts with its newer network."""

NUMBERS = config.SACHyperparameters(learning_rate=1e-3, temperature=0.1, polyak=0.005)
"""Numbers of soft actor-critic, and its dial; not tuned."""

DEMONSTRATED = config.ActorIQLearnHyperparameters(
    learning_rate=1e-3, temperature=0.1, polyak=0.005, prior_weight=30.0
)
"""Numbers of IQ-Learn, and its dial; not tuned."""


def train_dials(
    task: Task,
    steps: int,
    seeds: Sequence[int],
    datasets: Sequence[Demonstrations] = (),
) -> list[ActorDial]:
    """Train a dial for each seed, online.

    Args:
        task: Where it acts.
        steps: In the environment, and gradient steps.
        seeds: Training seeds.
        datasets: Demonstrations for each seed; none for a dial that learns from its rewards alone.
    """
    if not datasets:
        trained = _sac(task, steps, [_numbers(task, seed) for seed in seeds], dial=True)
    else:
        static = dataclasses.replace(_demonstrated(task, steps), dial=True)
        numbers = [
            dataclasses.replace(DEMONSTRATED, seed=seed, dataset=number, discount=task.discount)
            for number, seed in enumerate(seeds)
        ]
        trained = _collected(task, static, numbers, datasets)
    return [trained.policy(run) for run in range(len(seeds))]


def train_standardised(task: Task, steps: int, seeds: Sequence[int]) -> list[ActorDial]:
    """Train a dial for each seed as `train_dials` without demonstrations, on other inputs.

    Each seed's observations are standardised by `EXPLORED` steps at random of its own.
    """
    changes = [Standardisation.of(explored(task.make(), seed)) for seed in seeds]
    trained = _sac(task, steps, [_numbers(task, seed) for seed in seeds], True, changes)
    pairs = zip(changes, (trained.policy(run) for run in range(len(seeds))), strict=True)
    return [change.policy(policy) for change, policy in pairs]


def train_experts(
    task: Task, steps: int, seeds: Sequence[int], angles: Sequence[float]
) -> list[list[ActorPolicy]]:
    """Train soft actor-critic at each angle, online; return each seed's policies."""
    numbers = [_numbers(task, seed, angle) for seed in seeds for angle in angles]
    trained = _sac(task, steps, numbers, dial=False)
    return _by_seed(trained, len(angles))


def train_trio(
    task: Task, datasets: Sequence[Demonstrations], seeds: Sequence[int], angles: Sequence[float]
) -> list[list[ActorPolicy]]:
    """Train IQ-Learn offline at each angle on the demonstrations of each seed."""
    static = dataclasses.replace(
        _demonstrated(task, 3000), online=False, value_term="value_expert", chi2_on="expert"
    )
    numbers = [
        dataclasses.replace(
            DEMONSTRATED, seed=seed, angle=angle, dataset=number, discount=task.discount
        )
        for number, seed in enumerate(seeds)
        for angle in angles
    ]
    return _by_seed(train(static, numbers, datasets), len(angles))


def _by_seed(trained: Trained, size: int) -> list[list[ActorPolicy]]:
    policies = [trained.policy(run) for run in range(len(trained.hyperparameters))]
    return [policies[first : first + size] for first in range(0, len(policies), size)]


def _numbers(task: Task, seed: int, angle: float = 0.0) -> config.SACHyperparameters:
    return dataclasses.replace(NUMBERS, seed=seed, angle=angle, discount=task.discount)


def _shared(task: Task, steps: int) -> dict[str, Any]:
    return {
        "hidden": task.hidden,
        "updates": steps,
        "replay_capacity": steps,
        "updates_per_round": ROUND,
    }


def _sac(
    task: Task,
    steps: int,
    numbers: Sequence[Any],
    dial: bool,
    changes: Sequence[Standardisation] = (),
) -> Trained:
    static = config.SACConfig(**_shared(task, steps), batch_size=task.batch_size, dial=dial)
    return _collected(task, static, numbers, changes=changes)


def _demonstrated(task: Task, updates: int) -> config.ActorIQLearnConfig:
    return config.ActorIQLearnConfig(
        **_shared(task, updates),
        batch_size=task.batch_size // 2,
        prior="shifted_chi2",
        chi2_on="mixture",
    )


def _collected(
    task: Task,
    static: Any,
    numbers: Sequence[Any],
    datasets: Sequence[Demonstrations] = (),
    changes: Sequence[Standardisation] = (),
) -> Trained:
    """Train with experience of the task, which goes on from round to round."""
    makers = [change.maker(task.make) for change in changes] or [task.make] * len(numbers)
    sources = [from_env(make(), ROUND, continuous=True, goes_on=True) for make in makers]
    seeds = [run.seed for run in numbers]
    collect = Collector(sources, seeds, drawing(static, static.env_steps_per_update))
    env = task.make()
    shape = sizes(env)[0], action_size(env)
    return train(static, numbers, datasets, None, shape, chunk=ROUND, before_chunk=collect)
