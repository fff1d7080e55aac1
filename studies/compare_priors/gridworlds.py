"""The comparison in a gridworld: train all runs of a method, evaluate each exactly."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS
from socialiq.evaluation.expert_demonstrations import MODES, trajectory_datasets
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.callbacks import Callbacks, Report
from socialiq.learners.collect import from_env
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.dqn.train import train as train_dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import priors
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score, weights
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.gym import GridWorldEnv
from socialiq_lab.comparison import nearest_mode, of_modes
from socialiq_lab.gridworld_runs import Ground, evaluate, train_runs
from socialiq_lab.jobs import ProgressCallback
from socialiq_lab.results import as_csv
from studies.compare_priors.config import Method, Run, settings

ROWS = "rows.csv"
"""File of a job's rows."""

CHUNK = 500
"""Updates between two reports, and between two rounds of acting in RL."""


@dataclass(frozen=True)
class GridRun:
    """A method in a gridworld, with seeds, angles and strengths."""

    world: str
    method: Method
    structure: iq.StaticConfig
    numbers: iq.Hyperparameters
    angles: tuple[float, ...]
    strengths: tuple[float, ...]
    seeds: tuple[int, ...]
    episodes_each: int


class Arena(NamedTuple):
    """Common inputs of all methods of a world.

    Attributes:
        ground: The world.
        structure: Network and budget; prior and target are the method's.
        numbers: Rates and discounts; angle, strength, seed and data set are the run's.
        datasets: A mixture for each seed.
        on_report: Progress callback.
    """

    ground: Ground
    structure: iq.StaticConfig
    numbers: iq.Hyperparameters
    datasets: Sequence[Demonstrations]
    on_report: Callable[[Report], None] | None = None

    def settings(self, method: Method, runs: Sequence[Run]) -> tuple[Any, list[Any]]:
        """Return the static config and the hyperparameters of a method's runs."""
        each = [settings(method, self.structure, self.numbers, run) for run in runs]
        return each[0][0], [hyperparameters for _, hyperparameters in each]


Learner = Callable[[Arena, Method, Sequence[Run]], list[QPolicy]]
"""Trains a policy for each run at the arena's budget."""


def _iq_learn(arena: Arena, method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    static, numbers = arena.settings(method, runs)
    trained = train_runs(
        arena.ground, static, numbers, arena.datasets, arena.on_report, CHUNK, lambda _: {}
    )
    return [trained.policy(run) for run in range(len(runs))]


def _clone(
    arena: Arena,
    method: Method,
    runs: Sequence[Run],
    datasets: Sequence[Demonstrations] | None = None,
) -> list[QPolicy]:
    static, numbers = arena.settings(method, runs)
    cloned = bc.BehaviourCloning.train_on(
        static, numbers, datasets or arena.datasets, Callbacks(arena.on_report), CHUNK
    )
    return [cloned.policy(run) for run in range(len(runs))]


def _clone_of_mode(arena: Arena, method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    """Clone only the mode nearest to the angle, as if every episode's mode were known."""
    parts = list(itertools.product(MODES, range(len(arena.datasets))))
    datasets = [of_modes(arena.datasets[number], (mode,)) for mode, number in parts]
    placed = [
        run._replace(dataset=parts.index((nearest_mode(run.angle), run.dataset))) for run in runs
    ]
    return _clone(arena, method, placed, datasets)


def _conservative(arena: Arena, method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    static, numbers = arena.settings(method, runs)
    trained = cql.ConservativeQ.train_on(
        static, numbers, arena.datasets, Callbacks(arena.on_report), CHUNK
    )
    return [trained.policy(run) for run in range(len(runs))]


def _reinforcement(arena: Arena, method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    """Train deep Q-learning on R(α) with as many environment steps, without demonstrations."""
    base, world = arena.structure, arena.ground.table.world
    static, numbers = arena.settings(method, runs)
    chunk = min(CHUNK, base.updates)
    env = GridWorldEnv(world.name)  # a source resets it first, so the runs can share it
    sources = [from_env(env, chunk * base.env_steps_per_update) for _ in runs]
    sizes = (world.n_features, world.n_actions)
    trained = train_dqn(static, numbers, sources, sizes, Callbacks(arena.on_report), chunk)
    return [trained.policy(run) for run in range(len(runs))]


def _dial(arena: Arena, method: Method, runs: Sequence[Run]) -> list[QPolicy]:
    """Train a network for all angles of a seed and λ, at the other rows' budget of an angle."""
    networks = list(dict.fromkeys(run._replace(angle=0.0) for run in runs))
    static, numbers = arena.settings(method, networks)
    callbacks, world = Callbacks(arena.on_report), arena.ground.table.world
    trained = train_dial(static, numbers, arena.datasets, world, callbacks=callbacks, chunk=CHUNK)
    return [trained.policy(networks.index(run._replace(angle=0.0))).at(run.angle) for run in runs]


LEARNERS: dict[str, Learner] = {
    "iq_learn": _iq_learn,
    "clone": _clone,
    "clone_of_mode": _clone_of_mode,
    "clone_weighted": _clone,
    "cql": _conservative,
    "rl": _reinforcement,
    "dial": _dial,
}
"""By the name in `Method.learner`."""


def run_method(
    config: GridRun, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train every run and write a row for each policy, angle and action selection."""
    ground, method = Ground.of(config.world), config.method
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    arena = Arena(
        ground,
        config.structure,
        config.numbers,
        datasets,
        lambda report: on_progress(0.9 * report.done / report.total),
    )
    trained = [
        Run(angle, strength, seed, dataset)
        for angle in (config.angles if method.by_angle else config.angles[:1])
        for strength in config.strengths
        for dataset, seed in enumerate(config.seeds)
    ]
    policies = LEARNERS[method.learner](arena, method, trained)
    rows: list[Row] = []
    for run, policy in zip(trained, policies, strict=True):
        angles = (run.angle,) if method.by_angle else config.angles
        rows += _rows(arena, config, run, policy, angles)
    write_atomically(folder / ROWS, as_csv(rounded(rows)))
    on_progress(1.0)


def _rows(
    arena: Arena, config: GridRun, run: Run, policy: QPolicy, angles: Sequence[float]
) -> list[Row]:
    """Return a policy's exact metrics, and its regret at each angle that it serves."""
    rows: list[Row] = []
    share = effective_share(arena, config.method, run)
    for readout in filter(config.method.readouts.__contains__, READOUTS):
        metrics = evaluate(arena.ground, policy, readout)
        for angle in angles:
            label = {"world": config.world, "method": config.method.name}
            label |= {"strength": run.strength, "target_angle": angle}
            label |= {"readout": readout, "seed": run.seed}
            regret = arena.ground.optimum.regret(metrics, angle)
            values = {"value": metrics.value(angle), "regret": regret, "effective_share": share}
            rows.append(label | metrics._asdict() | values)
    return rows


def effective_share(arena: Arena, method: Method, run: Run) -> float:
    """Return the effective share of transitions under a method's weights (B.2); 0 without data."""
    data = arena.datasets[run.dataset]
    if method.learner == "rl":
        return 0.0
    if method.learner == "clone_of_mode":
        return of_modes(data, (nearest_mode(run.angle),)).n_transitions / data.n_transitions
    if method.learner == "clone_weighted":
        numbers = bc.Hyperparameters(angle=run.angle, reweight_temperature=1 / run.strength)
        return bc.effective_size(data, numbers) / data.n_transitions
    if method.prior != "reweighting":
        return 1.0
    returns = data.returns(method.target_kind, arena.structure.social_discount)
    scores = jnp.asarray(score(weights(run.angle), returns))
    every = jnp.ones(len(scores), bool)
    of_rows = priors.demonstration_weights(scores, every, 1 / run.strength)
    return float(priors.effective_sample_size(of_rows)) / data.n_transitions
