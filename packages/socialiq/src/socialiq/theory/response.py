"""Response of the minimum to λ: straight lines as τ → 0, and flips of greedy actions along λ."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.mdp.tabular import StateActionArray
from socialiq.theory.objective import Problem, orthogonal


class Flip(NamedTuple):
    """Predicted strength at which the greedy action of a state changes, by straight lines."""

    state: int  # index of the state
    before: int  # the greedy action at λ = 0
    after: int  # the action that replaces it first
    strength: float  # λ of the change; infinite if there is none


def occupancy_slope(problem: Problem) -> StateActionArray:
    """Return dρ/dλ = 2 w ρ_E T_⊥, valid from λ = 0 until an occupancy is 0, as τ → 0.

    The limit is a quadratic program, min ‖ρ - ρ_E (1 + 2 w λ T̄)‖² in the norm of 1 / ρ_E over the
    occupancies. Until ρ ≥ 0 binds it is a projection onto the flow.
    """
    left = orthogonal(problem.mdp, problem.demonstrated, problem.target, problem.discount)
    return 2.0 * problem.prior_weight * problem.demonstrated * left.target


def target_slope(problem: Problem) -> float:
    """Return dE_ρ[T̄]/dλ = 2 w ‖T_⊥‖², with the same reach as `occupancy_slope`."""
    left = orthogonal(problem.mdp, problem.demonstrated, problem.target, problem.discount)
    return 2.0 * problem.prior_weight * left.norm**2


def reach(level: StateActionArray, slope: StateActionArray) -> float:
    """Return the λ at which the first positive level falls to 0: the lines are exact up to it.

    Args:
        level: Occupancy or share of each (state, action) at λ = 0.
        slope: Its derivative by λ.

    Returns:
        λ; infinite if no positive level falls.
    """
    falling = (level > 0.0) & (slope < 0.0)
    return float((level[falling] / -slope[falling]).min(initial=np.inf))


def flips(level: StateActionArray, slope: StateActionArray) -> list[Flip]:
    """Return the first change of the greedy action of each state with two demonstrated actions.

    λ_flip = [level(a1) - level(a2)] / [slope(a2) - slope(a1)], the least over a2. It is exact where
    it is within `reach`, and an extrapolation beyond.

    Args:
        level: ρ_E(s, a), or the demonstrators' shares of actions; 0 where not demonstrated.
        slope: Derivative of the level by λ.

    Returns:
        One flip for each state with two or more demonstrated actions, by ascending λ.
    """
    flips = []
    for state in np.flatnonzero((level > 0.0).sum(axis=1) > 1):
        lead = int(level[state].argmax())
        gaining = slope[state] - slope[state, lead]
        possible = (level[state] > 0.0) & (gaining > 0.0)
        strength = np.full(len(gaining), np.inf)
        behind = level[state, lead] - level[state]
        strength[possible] = behind[possible] / gaining[possible]
        after = int(strength.argmin())
        flips.append(Flip(int(state), lead, after, float(strength[after])))
    return sorted(flips, key=lambda flip: flip.strength)


def extinction(
    shares: Float[np.ndarray, " mode"], targets: Float[np.ndarray, " mode"], prior_weight: float
) -> Float[np.ndarray, " mode"]:
    """Return λ_k = 1 / [2 w (T̄_p - T_k)], at which a mode has probability 0, as τ → 0.

    In a world of a single state, π_k = p_k [1 + 2 w λ (T_k - T̄_p)] with the mean T̄_p = Σ p_k T_k.
    A mode that is no worse than the mean keeps a positive probability (infinite λ_k). With three
    modes or more the formula holds until the first mode has probability 0.

    Args:
        shares: p_k, the share of each mode among the demonstrations.
        targets: T_k, the target of each mode, in units of reward.
        prior_weight: w of Eq 4.5.

    Returns:
        λ_k of each mode.

    Raises:
        UserError: If the shares are not a distribution.
    """
    if shares.min() < 0.0 or abs(shares.sum() - 1.0) > 1e-9:
        raise UserError("shares of modes are 0 or more, and sum to 1")
    worse = shares @ targets - targets
    with np.errstate(divide="ignore"):
        return np.where(worse > 0.0, 1.0 / (2.0 * prior_weight * np.maximum(worse, 0.0)), np.inf)


_PRECISION = 1e-3  # of a flip's λ, relative

QSolver = Callable[[Problem, StateActionArray | None], StateActionArray]
"""(problem, Q of a similar problem) -> Q; `minimise(...).q` or `semi_gradient.fixed_point`."""


def found_flips(problem: Problem, solve: QSolver, strengths: Sequence[float]) -> list[Flip]:
    """Return the least λ at which each state's greedy action differs from that at λ = 0.

    The first step of `strengths` with another action is bisected to a relative width of 0.001. A
    flip and its reversal within one step are not detected.

    Args:
        problem: The problem; its own strength is not used.
        solve: Solver that returns the table Q of a problem.
        strengths: Values of λ that rise, the ends of the steps that are searched from λ = 0 on.

    Returns:
        A flip for each state with two or more demonstrated actions, by ascending λ; infinite if no
        change is found.
    """

    def q_at(strength: float, start: StateActionArray | None) -> StateActionArray:
        return solve(dataclasses.replace(problem, strength=strength), start)

    low = 0.0
    q = q_at(0.0, None)
    lead = q.argmax(axis=1)
    waiting = [int(s) for s in np.flatnonzero(problem.support.sum(axis=1) > 1)]
    flips: list[Flip] = []
    for high in map(float, strengths):
        if not waiting:
            break
        after = q_at(high, q)
        for state in [s for s in waiting if after[s].argmax() != lead[s]]:
            waiting.remove(state)

            def before(table: StateActionArray, state: int = state) -> bool:
                return bool(table[state].argmax() == lead[state])

            strength, table = _halved(q_at, before, (low, q), (high, after))
            flips.append(Flip(state, int(lead[state]), int(table[state].argmax()), strength))
        low = high
        q = after
    flips += [Flip(state, int(lead[state]), int(lead[state]), np.inf) for state in waiting]
    return sorted(flips, key=lambda flip: flip.strength)


def first_flip(problem: Problem, solve: QSolver, strengths: Sequence[float]) -> float:
    """Return the least λ at which any greedy action differs from that at λ = 0.

    This is the least strength of `found_flips`, found without bisecting for any other state.

    Args:
        problem: The problem; its own strength is not used.
        solve: Solver that returns the table Q of a problem.
        strengths: Values of λ that rise, the ends of the steps that are searched from λ = 0 on.

    Returns:
        λ, to a relative width of 0.001; infinite if no change is found.
    """

    def q_at(strength: float, start: StateActionArray | None) -> StateActionArray:
        return solve(dataclasses.replace(problem, strength=strength), start)

    def before(q: StateActionArray) -> bool:
        return bool((q[choices].argmax(axis=1) == lead).all())

    choices = np.flatnonzero(problem.support.sum(axis=1) > 1)
    below = 0.0, q_at(0.0, None)
    lead = below[1][choices].argmax(axis=1)
    for strength in map(float, strengths):
        above = strength, q_at(strength, below[1])
        if not before(above[1]):
            return _halved(q_at, before, below, above)[0]
        below = above
    return float("inf")


def _halved(
    q_at: Callable[[float, StateActionArray | None], StateActionArray],
    before: Callable[[StateActionArray], bool],
    below: tuple[float, StateActionArray],
    above: tuple[float, StateActionArray],
) -> tuple[float, StateActionArray]:
    """Bisect an interval of λ, at whose lower end only `before` holds; return the upper end."""
    while above[0] - below[0] > _PRECISION * above[0]:
        middle = (below[0] + above[0]) / 2.0
        q = q_at(middle, below[1])
        below, above = ((middle, q), above) if before(q) else (below, (middle, q))
    return above
