"""Trained networks against their predictions, and how many predictions hold."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from socialiq import Demonstrations, RewardPair
from socialiq.evaluation.exact import READOUTS, Ground, action_table
from socialiq.evaluation.prediction import (
    NEXT_VALUES,
    NextValue,
    Setting,
    lines_of,
    problem_of,
    target_norm,
)
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.config import IQLearnHyperparameters
from socialiq.mdp.solve import evaluate_policy
from socialiq.theory import response, semi_gradient
from socialiq.theory.minimise import minimise
from socialiq.theory.objective import Problem
from socialiq.theory.response import QSolver, first_flip
from socialiq.theory.semi_gradient import equilibrium
from socialiq.types import Row
from socialiq_lab.gridworld_runs import evaluate, train_runs
from socialiq_lab.jobs import StageCallback
from socialiq_lab.tables import column, groups, matching, mean

ANGLE = 0.0
TARGETS = ("instantaneous", "to_go", "advantage")
"""Targets of the networks' prior; the advantage is that of the pooled policy."""

SOLVERS: dict[str, QSolver] = {
    "online": lambda problem, start: minimise(problem, start).q,
    "target": semi_gradient.fixed_point,
}
"""Q at the limit of training, by `next_value`."""


def rows_problem(ground: Ground, kind: str) -> Problem:
    """Return the problem of the networks' rows; flips of advantages are those of rewards.

    Args:
        ground: Gridworld of the networks.
        kind: Target of the networks' prior, from `TARGETS`.
    """
    return problem_of(ground.part, Setting(ANGLE, _target_kind(kind), measure="rows"))


def _target_kind(kind: str) -> str:
    """Return the target kind of the learner; advantages are instantaneous shaped rewards."""
    return "instantaneous" if kind == "advantage" else kind


def predicted_rows(ground: Ground, targets: Sequence[str]) -> list[Row]:
    """Return the first flip by each kind of prediction, for each gradient and target.

    `occupancy` and `rows` are straight lines for τ → 0. `solved` is the exact solution for rows at
    the networks' temperature, as if trained offline; `replay` is the same with the learner's own
    rows in half of term 2, as in the training of the networks.

    Args:
        ground: Gridworld of the networks.
        targets: Targets of the prior, from `TARGETS`.

    Returns:
        A row for each gradient and target; a flip is a value of λ, infinite if there is none.
    """
    predictions = []
    mdp = ground.part.mdp
    horizon = ground.part.world.horizon
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


def trainings(config: Any) -> Iterator[tuple[NextValue, str]]:
    """Yield every gradient and target of the configuration that is trained."""
    for next_value, kind in itertools.product(NEXT_VALUES, config.target_kinds):
        if (next_value, kind) != ("online", "advantage"):
            yield next_value, kind


def flips_of(runs: Sequence[Row]) -> list[Row]:
    """Return a row for each gradient, target and seed: the least λ with other choices."""
    flips = []
    for (next_value, kind, seed), rows in groups(runs, "next_value", "target_kind", "seed").items():
        baseline = next(row["choices"] for row in rows if row["prior_weight"] == 0.0)
        grid = sorted((r for r in rows if r["prior_weight"] > 0.0), key=lambda r: r["strength"])
        left = [number for number, row in enumerate(grid) if row["choices"] != baseline]
        first = left[0] if left else None
        flips.append(  # the least λ with other choices than the baseline's
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


def trained_rows(
    config: Any, next_value: NextValue, kind: str, on_stage: StageCallback
) -> list[Row]:
    """Train the baseline, λ = 0 and the grid, for every seed.

    Args:
        config: Configuration of the study.
        next_value: Network that gives V(s'), "online" or "target".
        kind: Target of the networks' prior, from `TARGETS`.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each run.
    """
    ground = Ground.of("crossing7")
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    problem = rows_problem(ground, kind)
    strengths = [0.0, *(unit / target_norm(problem) for unit in config.units)]
    static = dataclasses.replace(
        presets.SWEEP, next_value=next_value, target_kind=_target_kind(kind), updates=config.updates
    )
    numbers: list[IQLearnHyperparameters] = []
    for dataset, seed in enumerate(config.seeds):
        base = presets.TABLE_C1_NUMBERS
        run = dataclasses.replace(base, angle=ANGLE, seed=seed, dataset=dataset)
        numbers.append(dataclasses.replace(run, prior_weight=0.0))  # the baseline, exactly
        numbers += [dataclasses.replace(run, strength=strength) for strength in strengths]
    if kind == "advantage":
        datasets = [shaped_by_value(ground, problem, data) for data in datasets]
    trained = train_runs(ground, static, numbers, datasets, Callbacks(on_stage(kind)))
    choices = np.flatnonzero(problem.support.sum(axis=1) > 1)
    rows = []
    for number, run in enumerate(numbers):
        policy = trained.policy(number)
        greedy = action_table(policy, ground.part, "greedy").argmax(axis=1)[choices]
        soft = action_table(policy, ground.part, "soft")[choices]
        row = {
            "next_value": next_value,
            "target_kind": kind,
            "seed": run.seed,
            "prior_weight": run.prior_weight,
            "strength": run.strength,
            "choices": "-".join(map(str, greedy)),
            "mean_go": float(soft[:, 1:].sum(axis=1).mean()),
        }
        lengths = {f"{r}_length": evaluate(ground, policy, r).length for r in READOUTS}
        rows.append(row | lengths)
    return rows


def shaped_by_value(ground: Ground, problem: Problem, data: Demonstrations) -> Demonstrations:
    """Return the rows with rewards r + γ (1 - d) V(s') - V(s), with V of the pooled policy.

    Args:
        ground: Gridworld of the demonstrations.
        problem: Problem of the networks' rows, which defines the pooled policy and γ.
        data: Demonstrations.
    """
    policy = semi_gradient.demonstrated_policy(problem)
    policy = np.where(policy.sum(axis=1, keepdims=True) > 0.0, policy, 1.0 / policy.shape[1])
    world = ground.table.world
    reachable = ground.part
    row_of_state = np.zeros(ground.table.mdp.n_states, np.int64)
    row_of_state[world.index(reachable.states)] = np.arange(len(reachable.states))
    before = row_of_state[world.index(np.rint(data.observation).astype(np.int64))]
    runs = ~(data.terminated | data.truncated)
    after = np.zeros_like(before)
    after[runs] = row_of_state[world.index(np.rint(data.next_observation[runs]).astype(np.int64))]
    shaped = []
    for reward, paid in zip(reachable.mdp.rewards, data.rewards, strict=True):
        v = evaluate_policy(problem.mdp, policy, reward, problem.discount).v
        shaped.append(paid + problem.discount * runs * v[after] - v[before])
    return dataclasses.replace(data, rewards=RewardPair(*shaped))


CLOSE = 0.15  # largest relative error of a hit
_PREDICTIONS = ("occupancy", "rows", "solved", "replay")


def hit(row: Row) -> bool:
    """Whether a flip was predicted and found, within 15 % of the λ found."""
    return "" not in (row["predicted"], row["found"]) and _error(row) <= CLOSE


def _error(row: Row) -> float:
    return abs(row["predicted"] / row["found"] - 1.0) if row["found"] != "" else float("inf")


def flip_counts(rows: list[Row], next_value: str) -> dict[str, Any]:
    """Return hits and misses of a gradient, over states and over first flips.

    Args:
        rows: Rows of `flip_rows`.
        next_value: Network that gives V(s'), "online" or "target".

    Returns:
        Counts by name; ties at λ = 0 are counted apart.
    """
    rows = matching(rows, next_value=next_value)
    flips = [row for row in rows if not row["tie"]]
    predicted = [row for row in flips if row["predicted"] != ""]
    unpredicted = matching(flips, predicted="")
    within = [row for row in predicted if row["within_reach"]]
    firsts = earliest(flips)
    grid = [row for row in firsts if not row["world"].startswith("random")]
    return {
        "states": len(flips),
        "predicted": len(predicted),
        "hits": sum(map(hit, predicted)),
        "not_found": len(matching(predicted, found="")),
        "found_unpredicted": sum(row["found"] != "" for row in unpredicted),
        "neither": len(matching(unpredicted, found="")),
        "within_reach": len(within),
        "within_reach_hits": sum(map(hit, within)),
        "first": len(firsts),
        "first_hits": sum(map(hit, firsts)),
        "first_in_grids": len(grid),
        "first_in_grids_hits": sum(map(hit, grid)),
        "first_in_grids_worst": max((_error(row) for row in grid), default=0.0),
        "ties": sum(column(rows, "tie")),
    }


def earliest(rows: list[Row]) -> list[Row]:
    """Return the first flip of each case: the least λ predicted, with the least found."""
    firsts = []
    for group in groups(rows, "next_value", "world", "angle", "target_kind").values():
        predicted = [row for row in group if row["predicted"] != ""]
        flips_found = [row["found"] for row in group if row["found"] != ""]
        if predicted:
            first = min(predicted, key=lambda row: row["predicted"])
            firsts.append(first | {"found": min(flips_found, default="")})
    return firsts


def growth(rows: list[Row]) -> dict[str, Any]:
    """Return lengths along λ by temperature, target and angle, and whether they never fall."""
    summary: dict[str, Any] = {}
    keys = ("temperature", "target_kind", "angle")
    for (temperature, kind, angle), path in groups(rows, *keys).items():
        soft = column(path, "soft_length")
        by_angle = summary.setdefault(f"{temperature:g}", {}).setdefault(kind, {})
        by_angle[f"{angle:g}"] = {
            "optimum": path[0]["optimum_length"],
            "soft": soft,
            "greedy": column(path, "greedy_length"),
            "soft_grows": bool((np.diff(soft) >= -1e-6).all()),
            "first": soft[0],
            "last": soft[-1],
        }
    return summary


def trained_summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Return predicted λ, and the seeds' first λ of the grid, by gradient and target.

    `bracketed` counts the seeds for which λ is between the grid's last value with the baseline's
    choices and the next; `zero_from_baseline` is the mean over seeds of |Δ| of the mean probability
    of going, λ = 0 less baseline.
    """
    summary: dict[str, Any] = {}
    for predicted in tables["predicted"]:
        key = {name: predicted[name] for name in ("next_value", "target_kind")}
        seeds = matching(tables["first_flips"], **key)
        if not seeds:
            continue
        firsts = sorted(row["first"] for row in seeds if row["first"] != "")
        median = firsts[len(seeds) // 2] if len(firsts) == len(seeds) else None
        runs = matching(tables["trained"], **key)
        regularized = [row for row in runs if row["prior_weight"] > 0.0]
        zero = column(matching(regularized, strength=0.0), "mean_go")
        baseline = column(matching(runs, prior_weight=0.0), "mean_go")
        strengths = sorted(set(column(regularized, "strength")))
        summary.setdefault(predicted["next_value"], {})[predicted["target_kind"]] = {
            name: predicted[name] for name in ("norm", *_PREDICTIONS)
        } | {
            "seeds": len(seeds),
            "left": len(firsts),
            "least": firsts[0] if firsts else None,
            "median": median,
            "greatest": firsts[-1] if firsts else None,
            "bracketed": {
                name: sum(bracketed(row, predicted[name]) for row in seeds) for name in _PREDICTIONS
            },
            "median_over_replay": None if median is None else median / predicted["replay"],
            "median_over_solved": None if median is None else median / predicted["solved"],
            "zero_leaves": sum(column(seeds, "zero_leaves")),
            "zero_from_baseline": float(np.mean(np.abs(np.subtract(zero, baseline)))),
            "lengths": {"strength": strengths}
            | {
                readout: [
                    mean(matching(regularized, strength=strength), f"{readout}_length")
                    for strength in strengths
                ]
                for readout in ("soft", "greedy")
            },
        }
    return summary


def bracketed(row: Row, strength: float) -> bool:
    """Whether λ is between the grid's last value with the baseline's choices and the next.

    Args:
        row: Row of a seed's first flip, from `trained_rows`.
        strength: λ that is predicted.
    """
    return row["first"] != "" and row["below"] != "" and row["below"] < strength <= row["first"]
