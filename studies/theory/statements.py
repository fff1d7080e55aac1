"""Cases of the study of the theory, and its statements that hold at any λ."""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from socialiq import Ending, RewardPair, tabulate
from socialiq.evaluation.prediction import Setting, problem_of
from socialiq.mdp import solve, tabular
from socialiq.theory.closed_form import (
    centre,
    closed_form,
    conservative_loss,
    dual_value,
    offset,
    primal_value,
)
from socialiq.theory.demonstrators import mean_target, occupancies
from socialiq.theory.minimise import minimise
from socialiq.theory.objective import Problem, shaped
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.registry import make_grid
from socialiq_lab.comparison import GRIDWORLDS

KINDS = ("instantaneous", "to_go")
ANGLES = (0.0, 45.0, 90.0)
_DISCOUNT = 0.9  # of the random worlds
_N_STATES = 10
_N_ACTIONS = 3
_N_OUTCOMES = 2


class Case(NamedTuple):
    """A problem with its name."""

    world: str  # "crossing5", "crossing7" or "random 3" (with the seed)
    angle: float  # α in degrees
    target_kind: str  # target of the prior
    problem: Problem  # the problem, at the default λ and τ

    @property
    def label(self) -> dict[str, str | float]:
        """Columns that name the case in a table."""
        return {"world": self.world, "angle": self.angle, "target_kind": self.target_kind}


def gridworlds() -> dict[str, Table]:
    """Return the reachable part of each gridworld."""
    return {name: tabulate(make_grid(name)).reachable_part() for name in GRIDWORLDS}


def grid_cases(
    worlds: dict[str, Table], kinds: Sequence[str] = KINDS, angles: Sequence[float] = ANGLES
) -> list[Case]:
    """Return the pool of equal numbers of episodes of each expert, at every angle and target.

    Args:
        worlds: Reachable part of each gridworld by name.
        kinds: Target kinds of the prior.
        angles: α in degrees.
    """
    return [
        Case(name, angle, kind, problem_of(reachable, Setting(angle, kind)))
        for name, reachable in worlds.items()
        for angle in angles
        for kind in kinds
    ]


def random_cases(seeds: Sequence[int], kinds: Sequence[str] = KINDS) -> list[Case]:
    """Return random worlds of ten states with three random demonstrators, one for each seed.

    Args:
        seeds: Seeds of the worlds.
        kinds: Target kinds of the prior.

    Returns:
        A case for each seed and kind; all kinds of a seed have the same world.
    """
    cases = []
    for seed, kind in itertools.product(seeds, kinds):
        rng = np.random.default_rng(seed)
        shape = (_N_STATES, _N_ACTIONS, _N_OUTCOMES)
        mdp = tabular.TabularMDP(
            successor=rng.integers(_N_STATES, size=shape),
            probability=rng.dirichlet(np.ones(_N_OUTCOMES), shape[:2]),
            ending=np.where(rng.random(shape) < 0.1, Ending.ARRIVAL, Ending.NONE),
            rewards=RewardPair(rng.normal(size=shape[:2]), rng.normal(size=shape[:2])),
            initial=rng.dirichlet(np.ones(_N_STATES)),
        )
        policies = [rng.dirichlet(np.full(_N_ACTIONS, 0.5), _N_STATES) for _ in range(3)]
        terms = occupancies(mdp, policies, [1 / 3] * 3, _DISCOUNT)
        target = mean_target(mdp, policies, terms, mdp.rewards.env, kind, _DISCOUNT)
        problem = Problem(mdp, terms.sum(axis=0), target, discount=_DISCOUNT)
        cases.append(Case(f"random {seed}", 0.0, kind, problem))
    return cases


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

    `log10_closed_error` has the largest distance of r̂ from the closed form, `log10_duality_gap`
    the relative difference of dual and primal value. `largest_correction` is the largest addition
    of the data to m, at most 1 / (2κ).
    """
    rows = []
    for case, strength, temperature in itertools.product(cases, STRENGTHS, TEMPERATURES):
        problem = dataclasses.replace(case.problem, strength=strength, temperature=temperature)
        minimum = minimise(problem)
        on = problem.support
        closed = closed_form(problem, minimum.occupancy)
        primal = primal_value(problem, minimum.occupancy)
        gap = dual_value(problem, minimum.loss) - primal
        rows.append(
            case.label
            | {
                "strength": strength,
                "temperature": temperature,
                "steps": minimum.steps,
                "log10_closed_error": log10(np.abs(minimum.reward[on] - closed[on]).max()),
                "log10_duality_gap": log10(gap / (1e-3 + abs(primal))),
                "largest_correction": float((minimum.reward[on] - centre(problem)[on]).max()),
                "bound": 1.0 / (2.0 * problem.curvature),
            }
        )
    return rows


def reward_rows(cases: Sequence[Case]) -> list[Row]:
    """Return centre, solved and closed r̂ of each demonstrated pair, at λ = 1 and τ = 1."""
    rows = []
    for case in cases:
        minimum = minimise(case.problem)
        closed = closed_form(case.problem, minimum.occupancy)
        prior = centre(case.problem)
        for state, action in np.argwhere(case.problem.support):
            rows.append(
                case.label
                | {
                    "state": int(state),
                    "action": int(action),
                    "centre": prior[state, action],
                    "solved": minimum.reward[state, action],
                    "closed": closed[state, action],
                }
            )
    return rows


def primal_rows(cases: Sequence[Case]) -> list[Row]:
    """Return the loss of primal value when another occupancy is mixed into the minimum's."""
    rows = []
    for case in cases:
        problem = case.problem
        best = minimise(problem).occupancy
        changes = {
            "λ = 0": {"strength": 0.0},
            "3 λ": {"strength": 3.0 * problem.strength},
            "opposite target": {"target": -problem.target},
        }
        others = {"demonstrators": problem.demonstrated} | {
            name: minimise(dataclasses.replace(problem, **change)).occupancy
            for name, change in changes.items()
        }
        value = primal_value(problem, best)
        for name, occupancy in others.items():
            for share in _MIXED.tolist():
                mixed = (1.0 - share) * best + share * occupancy
                lost = (value - primal_value(problem, mixed)) / problem.demonstrated.sum()
                label = case.label | {"other": name, "share": share}
                rows.append(label | {"log10_lost": log10(lost), "gained": int(lost < 0.0)})
    return rows


def shaping_rows(cases: Sequence[Case], targets: Mapping[str, Sequence[Case]]) -> list[Row]:
    """Return the largest differences of a probability from the policy of instantaneous targets.

    Args:
        cases: Problems with instantaneous targets.
        targets: The same problems by target kind, each sequence in the order of `cases`.

    Returns:
        A row for each case and change: five random potentials, and each further target.
    """
    rows = []
    for number, case in enumerate(cases):
        problem = case.problem
        rng = np.random.default_rng(number)
        base = minimise(problem).policy
        changed = []
        for _ in range(_N_POTENTIALS):
            potential = rng.normal(scale=10.0, size=problem.mdp.n_states)
            target = shaped(problem.mdp, problem.target, potential, problem.discount)
            changed.append(("random shaping", dataclasses.replace(problem, target=target)))
        changed += [(name, same[number].problem) for name, same in targets.items()]
        for change, compared in changed:
            gap = np.abs(minimise(compared).policy - base).max()
            label = {"world": case.world, "angle": case.angle, "change": change}
            rows.append(label | {"log10_difference": log10(gap)})
    return rows


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
    for number, case in enumerate(cases):
        problem = case.problem
        rng = np.random.default_rng(number)
        selected = np.asarray(problem.support.any(axis=1))
        for _ in range(5):
            draw = rng.normal(scale=3.0, size=problem.support.shape)
            q = np.where(problem.support, draw, -np.inf)
            v = np.zeros(problem.mdp.n_states)
            v[selected] = solve.soft_value(q[selected], problem.temperature)
            loss = problem.loss(q, v)
            compared = conservative_loss(problem, q, v) + offset(problem)
            error = log10(loss / compared - 1.0)
            row = {"loss": loss, "conservative": compared, "log10_error": error}
            rows.append(case.label | row)
    return rows
