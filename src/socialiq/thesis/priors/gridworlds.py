"""The comparison in a gridworld: train all lanes of a method, evaluate each exactly."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS, Readout, evaluate_exactly
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.collect import from_env
from socialiq.learners.dqn import config as dqn
from socialiq.learners.dqn.train import train as train_dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import priors
from socialiq.learners.outside import Outside, Report
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import weights
from socialiq.social.score import score
from socialiq.storage import write_atomically
from socialiq.thesis.experts import MODES, trajectory_datasets
from socialiq.thesis.jobs import Tell
from socialiq.thesis.lanes import Ground, evaluate, train_lanes
from socialiq.thesis.priors.methods import Method, nearest_mode
from socialiq.thesis.store import Row, as_csv, rounded
from socialiq.worlds.experts import expert_policy
from socialiq.worlds.gym import GridWorldEnv

ROWS = "rows.csv"
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


@dataclass(frozen=True)
class GridRun:
    """One method in one world on some seeds, angles and strengths."""

    world: str
    method: Method
    structure: iq.Structure
    numbers: iq.Numbers
    angles: tuple[float, ...]
    strengths: tuple[float, ...]
    seeds: tuple[int, ...]
    episodes_each: int


def run_method(config: GridRun, folder: Path, _inputs: Mapping[str, Path], tell: Tell) -> None:
    """Train every lane and write a row for each policy, angle and readout."""
    ground, method = Ground.of(config.world), config.method
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    arena = Arena(
        ground,
        config.structure,
        config.numbers,
        datasets,
        lambda report: tell(0.9 * report.done / report.total),
    )
    trained = [
        Lane(angle, strength, seed, dataset)
        for angle in (config.angles if method.by_angle else config.angles[:1])
        for strength in config.strengths
        for dataset, seed in enumerate(config.seeds)
    ]
    policies = LEARNERS[method.learner](arena, method, trained)
    rows: list[Row] = []
    for lane, policy in zip(trained, policies, strict=True):
        angles = (lane.angle,) if method.by_angle else config.angles
        rows += _rows(arena, config, lane, policy, angles)
    write_atomically(folder / ROWS, as_csv(rounded(rows)))
    tell(1.0)


def _rows(
    arena: Arena, config: GridRun, lane: Lane, policy: QPolicy, angles: Sequence[float]
) -> list[Row]:
    """One policy's exact metrics, and its regret at each angle that it serves."""
    found: list[Row] = []
    share = effective_share(arena, config.method, lane)
    for readout in config.method.readouts:
        metrics = evaluate(arena.ground, policy, _checked(readout))
        for angle in angles:
            label = {"world": config.world, "method": config.method.name}
            label |= {"strength": lane.strength, "target_angle": angle}
            label |= {"readout": readout, "seed": lane.seed}
            regret = arena.ground.optimum.regret(metrics, angle)
            worth = {"value": metrics.value(angle), "regret": regret, "effective_share": share}
            found.append(label | metrics._asdict() | worth)
    return found


def _checked(readout: str) -> Readout:
    return next(one for one in READOUTS if one == readout)


def effective_share(arena: Arena, method: Method, lane: Lane) -> float:
    """Which share of the transitions a method's weights leave in effect (B.2); 0 without any."""
    data = arena.datasets[lane.dataset]
    if method.learner == "rl":
        return 0.0
    if method.learner == "clone_of_mode":
        return _of_mode(data, lane.angle).n_transitions / data.n_transitions
    if method.learner == "clone_weighted":
        numbers = bc.Numbers(angle=lane.angle, reweight_temperature=1 / lane.strength)
        return bc.effective_size(data, numbers) / data.n_transitions
    if method.prior != "reweighting":
        return 1.0
    returns = data.returns(method.target_kind, arena.structure.social_discount)
    scores = jnp.asarray(score(weights(lane.angle), returns))
    every = jnp.ones(len(scores), bool)
    found = priors.demonstration_weights(scores, every, 1 / lane.strength)
    return float(priors.effective_sample_size(found)) / data.n_transitions


def references(world: str, angles: Sequence[float]) -> list[Row]:
    """At each angle the regret of each demonstrator, and of value iteration's policy for it.

    A learner that only chooses among the demonstrators can't do better than the best of them.
    """
    ground = Ground.of(world)
    kept = ground.table.mdp.reachable()

    def regret(of: float, at: float) -> float:
        metrics = evaluate_exactly(ground.part, expert_policy(ground.table, of)[kept])
        return ground.optimum.regret(metrics, at)

    return [
        {"world": world, "target_angle": angle, "value_iteration": regret(angle, angle)}
        | {mode: regret(own, angle) for mode, own in MODES.items()}
        for angle in angles
    ]


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
    parts = [_of_mode(arena.datasets[number], MODES[mode]) for mode, number in own]
    placed = [lane._replace(dataset=own[nearest_mode(lane.angle), lane.dataset]) for lane in lanes]
    return _clone(arena, placed, parts, weighted=False)


def _of_mode(data: Demonstrations, angle: float) -> Demonstrations:
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


LEARNERS: dict[str, Learner] = {
    "iq_learn": _iq_learn,
    "clone": _clone_pooled,
    "clone_of_mode": _clone_of_mode,
    "clone_weighted": _clone_weighted,
    "cql": _conservative,
    "rl": _reinforcement,
}
"""By the name in `Method.learner`."""
