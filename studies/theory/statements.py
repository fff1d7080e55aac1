"""Statements that hold at any λ: fixed point, primal form, shaping, λ = 0, offline identity."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from socialiq.mdp.solve import soft_value
from socialiq.theory.closed_form import (
    centre,
    closed_form,
    conservative_loss,
    dual_value,
    offset,
    primal_value,
)
from socialiq.theory.minimise import minimise
from socialiq.theory.objective import Problem
from socialiq.theory.shaping import shaped
from socialiq.types import Row
from studies.theory.cases import Case

STRENGTHS = (0.0, 0.3, 1.0)
TEMPERATURES = (1.0, 0.01)
_N_POTENTIALS = 5
_MIXED = np.geomspace(1e-3, 1.0, 13)
_NOTHING = 1e-17  # below the rounding of a probability; replaces exactly 0


def log10(value: Any) -> float:
    """Return the decimal logarithm of a size, at least -17: tables keep six decimals."""
    return float(np.log10(max(abs(float(value)), _NOTHING)))


def minimum_rows(cases: Sequence[Case]) -> list[Row]:
    """Return the errors of the minimum by two certificates, for each case, λ and τ.

    `log10_closed_error` is of the largest distance of r̂ from the closed form, `log10_duality_gap`
    of the relative difference of dual and primal value. `largest_correction` is the largest
    addition of the data to m, at most 1 / (2κ).
    """
    rows = []
    for case in cases:
        for strength in STRENGTHS:
            for temperature in TEMPERATURES:
                problem = dataclasses.replace(
                    case.problem, strength=strength, temperature=temperature
                )
                found, on = minimise(problem), problem.support
                closed = closed_form(problem, found.occupancy)
                primal = primal_value(problem, found.occupancy)
                gap = dual_value(problem, found.loss) - primal
                rows.append(
                    case.label
                    | {
                        "strength": strength,
                        "temperature": temperature,
                        "steps": found.steps,
                        "log10_closed_error": log10(np.abs(found.reward[on] - closed[on]).max()),
                        "log10_duality_gap": log10(gap / (1e-3 + abs(primal))),
                        "largest_correction": float((found.reward[on] - centre(problem)[on]).max()),
                        "bound": 1.0 / (2.0 * problem.curvature),
                    }
                )
    return rows


def reward_rows(cases: Sequence[Case]) -> list[Row]:
    """Return centre, solved and closed r̂ of each demonstrated pair, at λ = 1 and τ = 1."""
    rows = []
    for case in cases:
        found = minimise(case.problem)
        closed, prior = closed_form(case.problem, found.occupancy), centre(case.problem)
        for state, action in np.argwhere(case.problem.support):
            rows.append(
                case.label
                | {
                    "state": int(state),
                    "action": int(action),
                    "centre": prior[state, action],
                    "solved": found.reward[state, action],
                    "closed": closed[state, action],
                }
            )
    return rows


def primal_rows(cases: Sequence[Case]) -> list[Row]:
    """Return the loss of primal value when another occupancy is mixed into the minimum's.

    The others are the demonstrators' occupancy, and the minima at λ = 0, at three times λ, and at
    the opposite target.
    """
    rows = []
    for case in cases:
        problem = case.problem
        best = minimise(problem).occupancy
        others = {
            "demonstrators": problem.demonstrated,
            "λ = 0": _occupancy(problem, strength=0.0),
            "3 λ": _occupancy(problem, strength=3.0 * problem.strength),
            "opposite target": _occupancy(problem, target=-problem.target),
        }
        value = primal_value(problem, best)
        for name, other in others.items():
            for share in _MIXED:
                mixed = (1.0 - share) * best + share * other
                lost = (value - primal_value(problem, mixed)) / problem.demonstrated.sum()
                rows.append(
                    case.label
                    | {"other": name, "share": float(share), "log10_lost": log10(lost)}
                    | {"gained": int(lost < 0.0)}
                )
    return rows


def _occupancy(problem: Problem, **changes: object) -> np.ndarray:
    return minimise(dataclasses.replace(problem, **changes)).occupancy


def shaping_rows(cases: Sequence[Case], targets: Mapping[str, Sequence[Case]]) -> list[Row]:
    """Return the largest difference of a probability from the policy of instantaneous targets.

    Args:
        cases: Cases with instantaneous targets.
        targets: The same cases with other targets, by the target's name.
    """
    rows = []
    for place, case in enumerate(cases):
        problem, rng = case.problem, np.random.default_rng(place)
        base = minimise(problem).policy
        for _ in range(_N_POTENTIALS):
            potential = rng.normal(scale=10.0, size=problem.mdp.n_states)
            target = shaped(problem.mdp, problem.target, potential, problem.discount)
            other = dataclasses.replace(problem, target=target)
            rows.append(_difference(case, "random shaping", base, other))
        for name, same in targets.items():
            rows.append(_difference(case, name, base, same[place].problem))
    return rows


def _difference(case: Case, change: str, base: np.ndarray, other: Problem) -> Row:
    gap = np.abs(minimise(other).policy - base).max()
    label = {"world": case.world, "angle": case.angle}
    return label | {"change": change, "log10_difference": log10(gap)}


def zero_rows(cases: Sequence[Case]) -> list[Row]:
    """Compare λ = 0 with the baseline (w = 0), and with the baseline of α_χ = 1/6."""
    rows = []
    for case in cases:
        zero = minimise(dataclasses.replace(case.problem, strength=0.0))
        plain = minimise(dataclasses.replace(case.problem, prior_weight=0.0))
        shrunk = minimise(dataclasses.replace(case.problem, prior_weight=0.0, chi2_alpha=1 / 6))
        rows.append(
            {
                "world": case.world,
                "largest_difference": float(np.abs(zero.policy - plain.policy).max()),
                "log10_from_baseline": log10(np.abs(zero.policy - plain.policy).max()),
                "log10_from_baseline_sixth": log10(np.abs(zero.policy - shrunk.policy).max()),
            }
        )
    return rows


def offline_rows(cases: Sequence[Case]) -> list[Row]:
    """Compare the objective with conservative Q-learning's plus the constant, at random Q."""
    rows = []
    for place, case in enumerate(cases):
        problem, rng = case.problem, np.random.default_rng(place)
        some = np.asarray(problem.support.any(axis=1))
        for _ in range(5):
            draw = rng.normal(scale=3.0, size=problem.support.shape)
            q, v = np.where(problem.support, draw, -np.inf), np.zeros(problem.mdp.n_states)
            v[some] = soft_value(q[some], problem.temperature)
            loss, other = problem.loss(q, v), conservative_loss(problem, q, v) + offset(problem)
            rows.append(
                case.label
                | {"loss": loss, "conservative": other, "log10_error": log10(loss / other - 1.0)}
            )
    return rows
