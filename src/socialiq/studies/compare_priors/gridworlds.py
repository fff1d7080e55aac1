"""The comparison in a gridworld: train all lanes of a method, evaluate each exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp

from socialiq.evaluation.exact import READOUTS, Readout, evaluate_exactly
from socialiq.evaluation.expert_demonstrations import MODES, trajectory_datasets
from socialiq.experiments.gridworld_runs import Ground, evaluate
from socialiq.experiments.jobs import ProgressCallback
from socialiq.experiments.results import as_csv
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import priors
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score, weights
from socialiq.storage import write_atomically
from socialiq.studies.compare_priors.budget import Run
from socialiq.studies.compare_priors.learners import LEARNERS, Arena, of_mode
from socialiq.studies.compare_priors.methods import Method
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.tabular_policy import expert_policy

ROWS = "rows.csv"


@dataclass(frozen=True)
class GridRun:
    """One method in one world on some seeds, angles and strengths."""

    world: str
    method: Method
    structure: iq.StaticConfig
    numbers: iq.Hyperparameters
    angles: tuple[float, ...]
    strengths: tuple[float, ...]
    seeds: tuple[int, ...]
    episodes_each: int


def run_method(
    config: GridRun, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train every lane and write a row for each policy, angle and readout."""
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
    """One policy's exact metrics, and its regret at each angle that it serves."""
    found: list[Row] = []
    share = effective_share(arena, config.method, run)
    for readout in config.method.readouts:
        metrics = evaluate(arena.ground, policy, _checked(readout))
        for angle in angles:
            label = {"world": config.world, "method": config.method.name}
            label |= {"strength": run.strength, "target_angle": angle}
            label |= {"readout": readout, "seed": run.seed}
            regret = arena.ground.optimum.regret(metrics, angle)
            worth = {"value": metrics.value(angle), "regret": regret, "effective_share": share}
            found.append(label | metrics._asdict() | worth)
    return found


def _checked(readout: str) -> Readout:
    return next(one for one in READOUTS if one == readout)


def effective_share(arena: Arena, method: Method, run: Run) -> float:
    """Effective share of the transitions under a method's weights (B.2); 0 without any."""
    data = arena.datasets[run.dataset]
    if method.learner == "rl":
        return 0.0
    if method.learner == "clone_of_mode":
        return of_mode(data, run.angle).n_transitions / data.n_transitions
    if method.learner == "clone_weighted":
        numbers = bc.Hyperparameters(angle=run.angle, reweight_temperature=1 / run.strength)
        return bc.effective_size(data, numbers) / data.n_transitions
    if method.prior != "reweighting":
        return 1.0
    returns = data.returns(method.target_kind, arena.structure.social_discount)
    scores = jnp.asarray(score(weights(run.angle), returns))
    every = jnp.ones(len(scores), bool)
    found = priors.demonstration_weights(scores, every, 1 / run.strength)
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
