"""Who trains each row of the comparison in a gridworld, all at one budget."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.collect import from_env
from socialiq.learners.dial import config as dial
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.dqn import config as dqn
from socialiq.learners.dqn.train import train as train_dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.outside import Outside, Report
from socialiq.nn.q_policy import QPolicy
from socialiq.thesis.experts import MODES
from socialiq.thesis.lanes import Ground, train_lanes
from socialiq.thesis.priors.methods import Method, nearest_mode
from socialiq.worlds.gym import GridWorldEnv

CHUNK = 500  # updates between two reports, and between two rounds of acting in RL


class Lane(NamedTuple):
    """One training run: angle in degrees, λ (or 1/τ_w), seed, and the number of its data set."""

    angle: float
    strength: float
    seed: int
    dataset: int


class Arena(NamedTuple):
    """What all methods of a world are given.

    Attributes:
        ground: The world.
        structure: Network and budget; prior and target are the method's.
        numbers: Rates and discounts; angle, strength, seed and data set are the lane's.
        datasets: One mixture for each seed.
        on_report: Told of progress.
    """

    ground: Ground
    structure: iq.Structure
    numbers: iq.Numbers
    datasets: Sequence[Demonstrations]
    on_report: Callable[[Report], None] | None = None


Learner = Callable[[Arena, Method, Sequence[Lane]], list[QPolicy]]
"""Trains one policy for each lane, at the arena's budget."""


def _iq_learn(arena: Arena, method: Method, lanes: Sequence[Lane]) -> list[QPolicy]:
    structure = structure_of(method, arena.structure)
    numbers = [numbers_of(arena.numbers, lane) for lane in lanes]
    trained = train_lanes(
        arena.ground, structure, numbers, arena.datasets, arena.on_report, CHUNK, lambda _: {}
    )
    return [trained.policy(lane) for lane in range(len(lanes))]


def structure_of(method: Method, base: iq.Structure) -> iq.Structure:
    """IQ-Learn's structure for a method."""
    changes: dict[str, Any] = {"prior": method.prior, "target_kind": method.target_kind}
    return dataclasses.replace(base, **changes, shift_term_3=method.shift_term_3)


def numbers_of(base: iq.Numbers, lane: Lane) -> iq.Numbers:
    """IQ-Learn's numbers for a lane; what multiplies R(α) is its strength, also in Eq B.2."""
    return dataclasses.replace(
        base,
        angle=lane.angle,
        strength=lane.strength,
        reweight_temperature=1 / lane.strength,
        seed=lane.seed,
        dataset=lane.dataset,
    )


def _clone(
    arena: Arena, lanes: Sequence[Lane], datasets: Sequence[Demonstrations], weighted: bool
) -> list[QPolicy]:
    structure = bc.Structure(
        arena.structure.hidden,
        arena.structure.activation,
        arena.structure.batch_size,
        arena.structure.updates,
        weighted,
    )
    numbers = [
        bc.Numbers(
            arena.numbers.learning_rate, lane.seed, lane.dataset, lane.angle, 1 / lane.strength
        )
        for lane in lanes
    ]
    cloned = bc.clone(structure, numbers, datasets, Outside(arena.on_report), CHUNK)
    return [cloned.policy(lane) for lane in range(len(lanes))]


def _clone_pooled(arena: Arena, _method: Method, lanes: Sequence[Lane]) -> list[QPolicy]:
    return _clone(arena, lanes, arena.datasets, weighted=False)


def _clone_weighted(arena: Arena, _method: Method, lanes: Sequence[Lane]) -> list[QPolicy]:
    return _clone(arena, lanes, arena.datasets, weighted=True)


def _clone_of_mode(arena: Arena, _method: Method, lanes: Sequence[Lane]) -> list[QPolicy]:
    """Only the mode nearest to the angle is cloned: what knowing every label would give."""
    own = {
        (mode, number): place
        for place, (mode, number) in enumerate(itertools.product(MODES, range(len(arena.datasets))))
    }
    parts = [of_mode(arena.datasets[number], MODES[mode]) for mode, number in own]
    placed = [lane._replace(dataset=own[nearest_mode(lane.angle), lane.dataset]) for lane in lanes]
    return _clone(arena, placed, parts, weighted=False)


def of_mode(data: Demonstrations, angle: float) -> Demonstrations:
    """The episodes of the mode nearest to an angle."""
    mode = data.mode_names.index(nearest_mode(angle))
    return data.select(np.flatnonzero(data.episode_modes == mode))


def _conservative(arena: Arena, _method: Method, lanes: Sequence[Lane]) -> list[QPolicy]:
    base, rates = arena.structure, arena.numbers
    structure = cql.Structure(
        base.endings, base.hidden, base.activation, base.view, base.batch_size, base.updates
    )
    numbers = [
        cql.Numbers(
            angle=lane.angle,
            strength=lane.strength,
            temperature=rates.temperature,
            discount=rates.discount,
            learning_rate=rates.learning_rate,
            polyak=rates.polyak,
            seed=lane.seed,
            dataset=lane.dataset,
        )
        for lane in lanes
    ]
    trained = cql.train(structure, numbers, arena.datasets, Outside(arena.on_report), CHUNK)
    return [trained.policy(lane) for lane in range(len(lanes))]


def _reinforcement(arena: Arena, _method: Method, lanes: Sequence[Lane]) -> list[QPolicy]:
    """Deep Q-learning on R(α) with as many steps in the world, and no demonstrations."""
    base, rates, world = arena.structure, arena.numbers, arena.ground.table.world
    structure = dqn.Structure(
        hidden=base.hidden,
        activation=base.activation,
        batch_size=base.batch_size,
        steps=base.updates * base.env_steps_per_update,
        steps_per_update=base.env_steps_per_update,
        replay_capacity=base.replay_capacity,
    )
    numbers = [
        dqn.Numbers(
            angle=lane.angle,
            discount=rates.discount,
            learning_rate=rates.learning_rate,
            final_learning_rate=rates.learning_rate,
            polyak=rates.polyak,
            seed=lane.seed,
        )
        for lane in lanes
    ]
    chunk = min(CHUNK, base.updates)
    env = GridWorldEnv(world.name)  # a source resets it first, so the lanes can share it
    sources = [from_env(env, chunk * base.env_steps_per_update) for _ in lanes]
    sizes = (world.n_features, world.n_actions)
    trained = train_dqn(structure, numbers, sources, sizes, Outside(arena.on_report), chunk)
    return [trained.policy(lane) for lane in range(len(lanes))]


def _dial(arena: Arena, _method: Method, lanes: Sequence[Lane]) -> list[QPolicy]:
    """One network for all angles of a seed and λ, at the budget that others have for each angle."""
    own = list(dict.fromkeys(lane._replace(angle=0.0) for lane in lanes))
    numbers = [dial_numbers(arena.numbers, lane) for lane in own]
    trained = train_dial(
        dial_structure(arena.structure),
        numbers,
        arena.datasets,
        arena.ground.table.world,
        outside=Outside(arena.on_report),
        chunk=CHUNK,
    )
    place = {lane: number for number, lane in enumerate(own)}
    return [trained.dial(place[lane._replace(angle=0.0)]).at(lane.angle) for lane in lanes]


def dial_structure(base: iq.Structure) -> dial.Structure:
    """The dial's structure at the others' budget."""
    return dial.Structure(
        endings=base.endings,
        hidden=base.hidden,
        activation=base.activation,
        view=base.view,
        expert_batch=base.batch_size,
        replay_batch=base.batch_size,
        updates=base.updates,
        environments=base.env_steps_per_update,
        replay_capacity=base.replay_capacity,
    )


def dial_numbers(rates: iq.Numbers, lane: Lane) -> dial.Numbers:
    """The dial's numbers for a lane, with the others' rates; the angle is asked for later."""
    return dial.Numbers(
        strength=lane.strength,
        temperature=rates.temperature,
        discount=rates.discount,
        learning_rate=rates.learning_rate,
        final_rate=1.0,
        polyak=rates.polyak,
        seed=lane.seed,
        dataset=lane.dataset,
    )


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
