"""Predictions against trained networks: the first λ of a grid without the baseline's choices."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS, action_table
from socialiq.evaluation.ground import Ground
from socialiq.evaluation.prediction import (
    NEXT_VALUES,
    NextValue,
    Setting,
    lines_of,
    problem_of,
    target_norm,
)
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import IQLearnHyperparameters
from socialiq.mdp.solve import evaluate_policy
from socialiq.theory import response, semi_gradient
from socialiq.theory.objective import Problem
from socialiq.theory.path import first_flip
from socialiq.theory.replay import equilibrium
from socialiq.types import RewardPair, Row
from socialiq_lab.gridworld_runs import evaluate, train_runs
from socialiq_lab.study import StageCallback
from socialiq_lab.tables import groups
from studies.theory.small_strength import SOLVERS

ANGLE = 0.0
TARGETS = ("instantaneous", "to_go", "advantage")
"""Targets of the networks' prior; the advantage is that of the pooled policy."""


class Plan(NamedTuple):
    """Size of the trainings.

    Attributes:
        targets: Targets of the networks' prior, of `TARGETS`.
        units: λ ‖T_⊥‖ of the grid, the same for every target.
        seeds: Training seeds, each with its own data set.
        updates: Gradient steps.
    """

    targets: tuple[str, ...]
    units: tuple[float, ...]
    seeds: tuple[int, ...]
    updates: int


def rows_problem(ground: Ground, kind: str) -> Problem:
    """Return the problem of the networks' rows; flips of advantages are those of rewards."""
    return problem_of(ground.part, Setting(ANGLE, _target_kind(kind), measure="rows"))


def _target_kind(kind: str) -> str:
    """Return the target kind of the learner; advantages are instantaneous shaped rewards."""
    return "instantaneous" if kind == "advantage" else kind


def predicted_rows(ground: Ground, targets: Sequence[str]) -> list[Row]:
    """Return the first flip by each kind of prediction, for each gradient and target.

    `occupancy` and `rows` are straight lines for τ → 0. `solved` is the exact solution for rows at
    the networks' temperature, as if trained offline; `replay` is the same with the learner's own
    rows in half of term 2, as in the training of the networks.
    """
    predictions = []
    mdp, horizon = ground.part.mdp, ground.part.world.horizon
    for next_value in NEXT_VALUES:
        for kind in targets:
            exact = problem_of(ground.part, Setting(ANGLE, kind))
            rows = rows_problem(ground, kind)
            span = (np.geomspace(0.05, 2.0, 17) / target_norm(rows)).tolist()

            def replay(problem: Problem, start: Any, way: NextValue = next_value) -> np.ndarray:
                return equilibrium(problem, mdp, horizon, way, start)

            predictions.append(
                {
                    "next_value": next_value,
                    "target_kind": kind,
                    "norm": target_norm(rows),
                    "occupancy": response.flips(*lines_of(exact, next_value))[0].strength,
                    "rows": response.flips(*lines_of(rows, next_value))[0].strength,
                    "solved": first_flip(rows, SOLVERS[next_value], span),
                    "replay": first_flip(rows, replay, span),
                }
            )
    return predictions


def trained_rows(
    ground: Ground, plan: Plan, datasets: Sequence[Demonstrations], on_stage: StageCallback
) -> tuple[list[Row], list[Row]]:
    """Train every gradient and target; return a row for each run and for each seed's flip."""
    runs: list[Row] = []
    for next_value in NEXT_VALUES:
        for kind in plan.targets:
            if (next_value, kind) != ("online", "advantage"):
                runs += _runs(ground, plan, datasets, on_stage, next_value, kind)
    return runs, _first_flips(runs)


def _runs(
    ground: Ground,
    plan: Plan,
    datasets: Sequence[Demonstrations],
    on_stage: StageCallback,
    next_value: NextValue,
    kind: str,
) -> list[Row]:
    """Train the baseline, λ = 0 and the grid, for every seed."""
    problem = rows_problem(ground, kind)
    strengths = [0.0, *(unit / target_norm(problem) for unit in plan.units)]
    static = dataclasses.replace(
        presets.SWEEP,
        next_value=next_value,
        target_kind=_target_kind(kind),
        updates=plan.updates,
    )
    base = presets.TABLE_C1_NUMBERS
    numbers: list[IQLearnHyperparameters] = []
    for dataset, seed in enumerate(plan.seeds):
        run = dataclasses.replace(base, angle=ANGLE, seed=seed, dataset=dataset)
        numbers.append(dataclasses.replace(run, prior_weight=0.0))  # the baseline, exactly
        numbers += [dataclasses.replace(run, strength=strength) for strength in strengths]
    data = [shaped_by_value(ground, problem, demonstrations) for demonstrations in datasets]
    report = on_stage(f"7x7, {kind} target, V(s') {next_value}")
    trained = train_runs(ground, static, numbers, data if kind == "advantage" else datasets, report)
    choices = np.flatnonzero(problem.support.sum(axis=1) > 1)
    rows = []
    for number, run in enumerate(numbers):
        policy = trained.policy(number)
        greedy = action_table(policy, ground.part, "greedy").argmax(axis=1)[choices]
        soft = action_table(policy, ground.part, "soft")[choices]
        lengths = {f"{r}_length": evaluate(ground, policy, r).length for r in READOUTS}
        rows.append(
            {
                "next_value": next_value,
                "target_kind": kind,
                "seed": run.seed,
                "prior_weight": run.prior_weight,
                "strength": run.strength,
                "choices": "-".join(map(str, greedy)),
                "mean_go": float(soft[:, 1:].sum(axis=1).mean()),
            }
            | lengths
        )
    return rows


def shaped_by_value(ground: Ground, problem: Problem, data: Demonstrations) -> Demonstrations:
    """Return the rows with rewards r + γ (1 - d) V(s') - V(s), with V of the pooled policy.

    These sampled advantages are a shaping of each row, so that only the networks can differ.
    """
    policy = semi_gradient.demonstrated_policy(problem)
    policy = np.where(policy.sum(axis=1, keepdims=True) > 0.0, policy, 1.0 / policy.shape[1])
    world, part = ground.table.world, ground.part
    place = np.zeros(ground.table.mdp.n_states, np.int64)
    place[world.index(part.states)] = np.arange(len(part.states))
    before = place[world.index(np.rint(data.observation).astype(np.int64))]
    runs = ~(data.terminated | data.truncated)
    after = np.zeros_like(before)
    after[runs] = place[world.index(np.rint(data.next_observation[runs]).astype(np.int64))]
    shaped = []
    for reward, column in zip(part.mdp.rewards, data.rewards, strict=True):
        v = evaluate_policy(problem.mdp, policy, reward, problem.discount).v
        shaped.append(column + problem.discount * runs * v[after] - v[before])
    return dataclasses.replace(data, rewards=RewardPair(*shaped))


def _first_flips(runs: list[Row]) -> list[Row]:
    """Return the least λ with other choices than the baseline's, by gradient, target and seed."""
    flips = []
    for (next_value, kind, seed), rows in groups(runs, "next_value", "target_kind", "seed").items():
        baseline = next(row["choices"] for row in rows if row["prior_weight"] == 0.0)
        grid = sorted((r for r in rows if r["prior_weight"] > 0.0), key=lambda r: r["strength"])
        left = [place for place, row in enumerate(grid) if row["choices"] != baseline]
        first = left[0] if left else None
        flips.append(
            {
                "next_value": next_value,
                "target_kind": kind,
                "seed": seed,
                "first": "" if first is None else grid[first]["strength"],
                "below": "" if not first else grid[first - 1]["strength"],
                "zero_leaves": int(first == 0),
            }
        )
    return flips
