"""Statements about small λ: the slope, the flips, and the length of episodes."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from socialiq import score
from socialiq.evaluation.prediction import NextValue, Setting, lines_of, problem_of
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.social.angle import exact_weights
from socialiq.theory import response, semi_gradient
from socialiq.theory.minimise import minimise
from socialiq.theory.objective import Problem
from socialiq.theory.response import QSolver, found_flips
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from studies.theory.statements import KINDS, Case

COLD = 1e-4  # temperature used for τ → 0, in units of reward
_PER_OCTAVE = 4
_TIE = 1e-9  # λ of a flip that is a tie in the data


SOLVERS: dict[str, QSolver] = {
    "online": lambda problem, start: minimise(problem, start).q,
    "target": semi_gradient.fixed_point,
}
"""Q at the limit of training, by `next_value`."""


def path_rows(cases: Sequence[Case], temperatures: Sequence[float]) -> list[Row]:
    """Return E_ρ[T̄] per unit of mass along λ and its straight line, up to 1.5 times the reach."""
    rows = []
    for case in cases:
        level = np.where(case.problem.support, case.problem.demonstrated, 0.0)
        reach = response.reach(level, response.occupancy_slope(case.problem))
        for temperature in temperatures:
            q = None
            for share in np.linspace(0.0, 1.5, 16):
                problem = dataclasses.replace(
                    case.problem, strength=share * reach, temperature=temperature
                )
                minimum = minimise(problem, q)
                q = minimum.q
                slope = response.target_slope(problem) / _mass(problem)
                line = _mean(problem, problem.demonstrated) + problem.strength * slope
                row = {"temperature": temperature, "strength": problem.strength, "reach": reach}
                row |= {"mean_target": _mean(problem, minimum.occupancy), "line": line}
                rows.append(case.label | row)
    return rows


def slope_rows(cases: Sequence[Case]) -> list[Row]:
    """Return dE_ρ[T̄]/dλ, predicted and measured at τ = `COLD` over a tenth of the reach."""
    rows = []
    for case in cases:
        problem = dataclasses.replace(case.problem, temperature=COLD)
        level = np.where(problem.support, problem.demonstrated, 0.0)
        reach = response.reach(level, response.occupancy_slope(problem))
        ends = [
            minimise(dataclasses.replace(problem, strength=share * reach)).occupancy
            for share in (0.45, 0.55)
        ]
        measured = (_mean(problem, ends[1]) - _mean(problem, ends[0])) / (0.1 * reach)
        predicted = response.target_slope(problem) / _mass(problem)
        row = {"reach": reach, "predicted": predicted, "measured": float(measured)}
        rows.append(case.label | row)
    return rows


def flip_rows(cases: Sequence[Case], next_value: NextValue) -> list[Row]:
    """Return predicted and found λ (at τ = `COLD`) of the first flip of every state with a choice.

    The search runs from a tenth of the first predicted flip, or of the reach, to ten times the
    last. A cell is empty where no flip is predicted, or none is found.
    """
    rows = []
    for case in cases:
        problem = dataclasses.replace(case.problem, temperature=COLD)
        lines = lines_of(problem, next_value)
        reach = response.reach(*lines)
        predicted = {flip.state: flip for flip in response.flips(*lines)}
        finite = [f.strength for f in predicted.values() if _TIE < f.strength < np.inf]
        low, high = 0.1 * min([reach, *finite]), 10.0 * max([reach, *finite])
        steps = int(np.ceil(_PER_OCTAVE * np.log2(high / low))) + 1
        flips = found_flips(problem, SOLVERS[next_value], np.geomspace(low, high, steps).tolist())
        for flip in flips:
            first = predicted[flip.state]
            row: Row = case.label | {"next_value": next_value, "state": flip.state}
            row |= {"before": first.before}
            row |= {"after": first.after if np.isfinite(first.strength) else ""}
            row |= {"predicted": first.strength if np.isfinite(first.strength) else ""}
            row |= {"within_reach": int(first.strength <= reach)}
            row |= {"found": flip.strength if np.isfinite(flip.strength) else ""}
            row |= {"found_after": flip.after if np.isfinite(flip.strength) else ""}
            row |= {"tie": int(first.strength <= _TIE)}
            rows.append(row)
    return rows


def length_rows(
    table: Table, angles: Sequence[float], strengths: Sequence[float], temperature: float
) -> list[Row]:
    """Return the expected steps of an episode of the exact solution for rows, along λ."""
    rows = []
    for angle in angles:
        reward = score(exact_weights(angle), table.mdp.rewards)
        best = horizon_optimum(table.mdp, reward, table.world.horizon)
        optimum = _length(table, best.probabilities(table.mdp.n_actions))
        for kind in KINDS:
            problem = problem_of(table, Setting(angle, kind, measure="rows"))
            q = None
            for strength in strengths:
                changed = dataclasses.replace(problem, strength=strength, temperature=temperature)
                minimum = minimise(changed, q)
                q = minimum.q
                greedy = np.eye(q.shape[1])[q.argmax(axis=1)]
                row = {"angle": angle, "target_kind": kind, "temperature": temperature}
                row |= {"strength": strength, "soft_length": _length(table, minimum.policy)}
                row |= {"greedy_length": _length(table, greedy), "optimum_length": optimum}
                rows.append(row)
    return rows


def _length(table: Table, policy: np.ndarray) -> float:
    return horizon_evaluation(table.mdp, policy, table.world.horizon).length


def _mass(problem: Problem) -> float:
    return float(problem.demonstrated.sum())


def _mean(problem: Problem, occupancy: np.ndarray) -> float:
    """Return E_ρ[T̄], divided by the mass of ρ_E."""
    on = problem.support
    return float(occupancy[on] @ problem.target[on]) / _mass(problem)
