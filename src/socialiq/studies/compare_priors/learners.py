"""Training of each row of the comparison in a gridworld, all at one budget."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.gridworld_runs import Ground, train_runs
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.callbacks import Callbacks, Report
from socialiq.learners.collect import from_env
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.dqn.train import train as train_dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.nn.q_policy import QPolicy
from socialiq.studies.compare_priors.budget import (
    Run,
    clone_numbers,
    clone_structure,
    cql_numbers,
    cql_structure,
    dial_numbers,
    dial_structure,
    numbers_of,
    rl_numbers,
    rl_structure,
    structure_of,
)
from socialiq.studies.compare_priors.methods import Method, nearest_mode
from socialiq.worlds.gym import GridWorldEnv

CHUNK = 500  # updates between two reports, and between two rounds of acting in RL


class Arena(NamedTuple):
    """Common inputs of all methods of a world.

    Attributes:
        ground: The world.
        structure: Network and budget; prior and target are the method's.
        numbers: Rates and discounts; angle, strength, seed and data set are the lane's.
        datasets: One mixture for each seed.
        on_report: Told of progress.
    """

    ground: Ground
    structure: iq.StaticConfig
    numbers: iq.Hyperparameters
    datasets: Sequence[Demonstrations]
    on_report: Callable[[Report], None] | None = None


Learner = Callable[[Arena, Method, Sequence[Run]], list[QPolicy]]
"""Trains one policy for each lane, at the arena's budget."""


def _iq_learn(arena: Arena, method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    structure = structure_of(method, arena.structure)
    numbers = [numbers_of(arena.numbers, run) for run in runs]
    trained = train_runs(
        arena.ground, structure, numbers, arena.datasets, arena.on_report, CHUNK, lambda _: {}
    )
    return [trained.policy(run) for run in range(len(runs))]


def _clone(
    arena: Arena, runs: Sequence[Run], datasets: Sequence[Demonstrations], weighted: bool
) -> list[QPolicy]:
    structure = clone_structure(arena.structure, weighted)
    numbers = [clone_numbers(arena.numbers, run) for run in runs]
    cloned = bc.clone(structure, numbers, datasets, Callbacks(arena.on_report), CHUNK)
    return [cloned.policy(run) for run in range(len(runs))]


def _clone_pooled(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    return _clone(arena, runs, arena.datasets, weighted=False)


def _clone_weighted(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    return _clone(arena, runs, arena.datasets, weighted=True)


def _clone_of_mode(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    """Only the mode nearest to the angle is cloned: what knowing every label would give."""
    own = {
        (mode, number): place
        for place, (mode, number) in enumerate(itertools.product(MODES, range(len(arena.datasets))))
    }
    parts = [of_mode(arena.datasets[number], MODES[mode]) for mode, number in own]
    placed = [run._replace(dataset=own[nearest_mode(run.angle), run.dataset]) for run in runs]
    return _clone(arena, placed, parts, weighted=False)


def of_mode(data: Demonstrations, angle: float) -> Demonstrations:
    """The episodes of the mode nearest to an angle."""
    mode = data.mode_names.index(nearest_mode(angle))
    return data.select(np.flatnonzero(data.episode_modes == mode))


def _conservative(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    structure = cql_structure(arena.structure)
    numbers = [cql_numbers(arena.numbers, run) for run in runs]
    trained = cql.train(structure, numbers, arena.datasets, Callbacks(arena.on_report), CHUNK)
    return [trained.policy(run) for run in range(len(runs))]


def _reinforcement(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    """Deep Q-learning on R(α) with as many steps in the world, and no demonstrations."""
    base, world = arena.structure, arena.ground.table.world
    numbers = [rl_numbers(arena.numbers, run) for run in runs]
    chunk = min(CHUNK, base.updates)
    env = GridWorldEnv(world.name)  # a source resets it first, so the lanes can share it
    sources = [from_env(env, chunk * base.env_steps_per_update) for _ in runs]
    sizes = (world.n_features, world.n_actions)
    trained = train_dqn(
        rl_structure(base), numbers, sources, sizes, Callbacks(arena.on_report), chunk
    )
    return [trained.policy(run) for run in range(len(runs))]


def _dial(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    """One network for all angles of a seed and λ, at the budget that others have for each angle."""
    own = list(dict.fromkeys(run._replace(angle=0.0) for run in runs))
    numbers = [dial_numbers(arena.numbers, run) for run in own]
    trained = train_dial(
        dial_structure(arena.structure),
        numbers,
        arena.datasets,
        arena.ground.table.world,
        callbacks=Callbacks(arena.on_report),
        chunk=CHUNK,
    )
    place = {run: number for number, run in enumerate(own)}
    return [trained.policy(place[run._replace(angle=0.0)]).at(run.angle) for run in runs]


LEARNERS: dict[str, Learner] = {
    "iq_learn": _iq_learn,
    "clone": _clone_pooled,
    "clone_of_mode": _clone_of_mode,
    "clone_weighted": _clone_weighted,
    "cql": _conservative,
    "rl": _reinforcement,
    "dial": _dial,
}
"""By the name in `Method.learner`."""
