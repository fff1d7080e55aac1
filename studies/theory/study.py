"""Statements and predictions of the theory against exact minima and trained networks."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import score
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.prediction import NEXT_VALUES, NextValue, Setting, lines_of, problem_of
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.social.angle import exact_weights
from socialiq.theory import response
from socialiq.theory.minimise import minimise
from socialiq.theory.objective import Problem
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, groups
from studies.theory import statements, training
from studies.theory.statements import KINDS, Case

COLD = 1e-4  # temperature used for τ → 0, in units of reward
_PER_OCTAVE = 4
_TIE = 1e-9  # λ of a flip that is a tie in the data


def jobs(config: Any) -> list[Job]:
    """Return a job for each training, and one for each table of exact problems."""
    trained = [
        Job(f"training/{value}, {kind}", table_rows, Part(config, (value, kind)), cost=5.0)
        for value, kind in training.trainings(config)
    ]
    exact = [Job(f"exact/{name}", table_rows, Part(config, name)) for name in exact_tables(config)]
    return trained + exact


@keeps_rows
def table_rows(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Train networks, or solve the problems of a table."""
    if isinstance(part.of, str):
        return {part.of: exact_tables(part.study)[part.of]()}
    next_value, kind = part.of
    return {"trained": training.trained_rows(part.study, next_value, kind, on_stage)}


def exact_tables(config: Any) -> dict[str, Callable[[], list[Row]]]:
    """Return the functions that solve the exact problems of each table."""
    worlds = statements.gridworlds()
    seeds = range(config.random_worlds)

    def cases(*kinds: str) -> list[statements.Case]:
        grids = statements.grid_cases(worlds, kinds, config.angles)
        return grids + statements.random_cases(seeds, kinds)

    grids = statements.grid_cases(worlds, angles=config.angles)
    every = grids + statements.random_cases(seeds)
    plain = [case for case in every if case.target_kind == "instantaneous"]
    chosen = [case for case in grids if case.world == "crossing7" and case.angle == 0.0]
    alternatives = {name: cases(name) for name in ("advantage", "own_advantage", "to_go")}
    seven = worlds["crossing7"]
    return {
        "minima": lambda: statements.minimum_rows(every),
        "rewards": lambda: statements.reward_rows(chosen),
        "primal": lambda: statements.primal_rows(chosen),
        "shaping": lambda: statements.shaping_rows(plain, alternatives),
        "zero": lambda: statements.zero_rows([case for case in plain if case.angle == 0.0]),
        "offline": lambda: statements.offline_rows(every),
        "path": lambda: path_rows(chosen, (COLD, 0.1, 1.0)),
        "slopes": lambda: slope_rows(every),
        "flips": lambda: [row for way in NEXT_VALUES for row in flip_rows(every, way)],
        "lengths": lambda: [
            row
            for temperature in (1.0, COLD)
            for row in length_rows(seven, config.angles, config.lengths, temperature)
        ],
        "predicted": lambda: training.predicted_rows(Ground.of("crossing7"), config.target_kinds),
    }


def compute_tables(config: Any, context: Context) -> Findings:
    """Compare exact problems and trained networks with the theory.

    Args:
        config: Configuration of the study.
        context: The finished jobs.

    Returns:
        All tables, and the largest errors, counts and lengths as summary.
    """
    tables = context.tables()
    tables["first_flips"] = training.flips_of(tables["trained"])
    return Findings(tables, _summary(tables, len(config.seeds)))


def _summary(tables: dict[str, list[Row]], seeds: int) -> dict[str, Any]:
    """Largest errors of each statement, ratios, counts and lengths."""

    def largest(table: str, name: str) -> float:
        return float(max(column(tables[table], name)))

    changes = {
        change: column(rows, "log10_difference")
        for (change,), rows in groups(tables["shaping"], "change").items()
    }
    slopes = [row["measured"] / row["predicted"] for row in tables["slopes"] if row["predicted"]]
    return {
        "seeds": seeds,
        "minima": len(tables["minima"]),
        "log10_closed_error": largest("minima", "log10_closed_error"),
        "log10_duality_gap": largest("minima", "log10_duality_gap"),
        "largest_correction": largest("minima", "largest_correction"),
        "primal_gained": largest("primal", "gained"),
        "log10_offline_error": largest("offline", "log10_error"),
        "shaping": {
            change: {"log10_largest": max(values), "log10_least": min(values)}
            for change, values in changes.items()
        },
        "zero": {
            "from_baseline": {row["world"]: row["largest_difference"] for row in tables["zero"]},
            "log10_from_baseline_sixth": largest("zero", "log10_from_baseline_sixth"),
        },
        "slopes": {"cases": len(slopes), "least_ratio": min(slopes), "largest_ratio": max(slopes)},
        "flips": {way: training.flip_counts(tables["flips"], way) for way in NEXT_VALUES},
        "lengths": training.growth(tables["lengths"]),
        "training": training.trained_summary(tables),
    }


def path_rows(cases: Sequence[Case], temperatures: Sequence[float]) -> list[Row]:
    """Return E_ρ[T̄] per unit of mass along λ and its straight line, up to 1.5 times the reach.

    Args:
        cases: Problems of the theory.
        temperatures: τ in units of reward.

    Returns:
        A row for each case, τ and step of λ, with the solved `mean_target` and the `line`.
    """
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
                row = {
                    "temperature": temperature,
                    "strength": problem.strength,
                    "reach": reach,
                    "mean_target": _mean(problem, minimum.occupancy),
                    "line": line,
                }
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

    Args:
        cases: Problems of the theory.
        next_value: Network that gives V(s'), "online" or "target".

    Returns:
        A row for each case and state with two or more demonstrated actions.
    """
    rows = []
    for case in cases:
        problem = dataclasses.replace(case.problem, temperature=COLD)
        lines = lines_of(problem, next_value)
        reach = response.reach(*lines)
        predicted = {flip.state: flip for flip in response.flips(*lines)}
        finite = [f.strength for f in predicted.values() if _TIE < f.strength < np.inf]
        low = 0.1 * min([reach, *finite])
        high = 10.0 * max([reach, *finite])
        steps = int(np.ceil(_PER_OCTAVE * np.log2(high / low))) + 1
        flips = response.found_flips(
            problem, training.SOLVERS[next_value], np.geomspace(low, high, steps).tolist()
        )
        for flip in flips:
            first = predicted[flip.state]
            rows.append(
                case.label
                | {
                    "next_value": next_value,
                    "state": flip.state,
                    "before": first.before,
                    "after": first.after if np.isfinite(first.strength) else "",
                    "predicted": first.strength if np.isfinite(first.strength) else "",
                    "within_reach": int(first.strength <= reach),
                    "found": flip.strength if np.isfinite(flip.strength) else "",
                    "found_after": flip.after if np.isfinite(flip.strength) else "",
                    "tie": int(first.strength <= _TIE),
                }
            )
    return rows


def length_rows(
    table: Table, angles: Sequence[float], strengths: Sequence[float], temperature: float
) -> list[Row]:
    """Return the expected steps of an episode of the exact solution for rows, along λ.

    Args:
        table: Reachable part of a gridworld.
        angles: α in degrees.
        strengths: Values of λ.
        temperature: τ in units of reward.

    Returns:
        A row for each angle, target kind and λ, with the lengths of the soft and the greedy policy
        and of the optimum.
    """
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
                rows.append(
                    {
                        "angle": angle,
                        "target_kind": kind,
                        "temperature": temperature,
                        "strength": strength,
                        "soft_length": _length(table, minimum.policy),
                        "greedy_length": _length(table, greedy),
                        "optimum_length": optimum,
                    }
                )
    return rows


def _length(table: Table, policy: np.ndarray) -> float:
    return horizon_evaluation(table.mdp, policy, table.world.horizon).length


def _mass(problem: Problem) -> float:
    return float(problem.demonstrated.sum())


def _mean(problem: Problem, occupancy: np.ndarray) -> float:
    """Return E_ρ[T̄], divided by the mass of ρ_E."""
    on = problem.support
    return float(occupancy[on] @ problem.target[on]) / _mass(problem)
