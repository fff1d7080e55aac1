"""Response of the minimum to λ as τ → 0: straight lines, and flips of greedy actions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.theory.objective import Problem
from socialiq.theory.shaping import orthogonal


class Flip(NamedTuple):
    """Predicted strength at which the greedy action of a state changes, by straight lines.

    Attributes:
        state: Index of the state.
        before: The greedy action at λ = 0.
        after: The action that replaces it first.
        strength: λ of the change; infinite if there is none.
    """

    state: int
    before: int
    after: int
    strength: float


def occupancy_slope(problem: Problem) -> Float[np.ndarray, "state action"]:
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


def reach(
    level: Float[np.ndarray, "state action"], slope: Float[np.ndarray, "state action"]
) -> float:
    """Return the λ at which the first positive level falls to 0: the lines are exact up to it."""
    falling = (level > 0.0) & (slope < 0.0)
    return float((level[falling] / -slope[falling]).min(initial=np.inf))


def flips(
    level: Float[np.ndarray, "state action"], slope: Float[np.ndarray, "state action"]
) -> list[Flip]:
    """Return the first change of the greedy action of each state with a choice.

    λ_flip = [level(a1) - level(a2)] / [slope(a2) - slope(a1)], the least over a2. It is exact where
    it is within `reach`, and an extrapolation beyond.

    Args:
        level: ρ_E(s, a), or the demonstrators' shares of actions; 0 where not demonstrated.
        slope: Derivative of `level` by λ.

    Returns:
        A flip for each state with two or more demonstrated actions, in ascending order of λ.
    """
    found = []
    for state in np.flatnonzero((level > 0.0).sum(axis=1) > 1):
        lead = int(level[state].argmax())
        gaining = slope[state] - slope[state, lead]
        possible = (level[state] > 0.0) & (gaining > 0.0)
        strength = np.full(len(gaining), np.inf)
        behind = level[state, lead] - level[state]
        strength[possible] = behind[possible] / gaining[possible]
        after = int(strength.argmin())
        found.append(Flip(int(state), lead, after, float(strength[after])))
    return sorted(found, key=lambda flip: flip.strength)


def flip_strengths(problem: Problem) -> list[Flip]:
    """Return the flips of the regularized objective with the gradient through every V."""
    level = np.where(problem.support, problem.demonstrated, 0.0)
    return flips(level, occupancy_slope(problem))


def extinction(
    shares: Float[np.ndarray, " mode"], targets: Float[np.ndarray, " mode"], prior_weight: float
) -> Float[np.ndarray, " mode"]:
    """Return λ_k = 1 / [2 w (T̄_p - T_k)], at which a mode has probability 0, as τ → 0.

    In a world of a single state, π_k = p_k [1 + 2 w λ (T_k - T̄_p)] with the mean T̄_p = Σ p_k T_k.
    A mode that is no worse than the mean keeps a positive probability (infinite λ_k). With three
    modes or more the formula holds until the first mode has probability 0.

    Args:
        shares: p_k, the demonstrated shares.
        targets: T_k of each mode; reward.
        prior_weight: w.

    Raises:
        UserError: If the shares are not a distribution.
    """
    if shares.min() < 0.0 or abs(shares.sum() - 1.0) > 1e-9:
        raise UserError("shares of modes are 0 or more, and sum to 1")
    worse = shares @ targets - targets
    with np.errstate(divide="ignore"):
        return np.where(worse > 0.0, 1.0 / (2.0 * prior_weight * np.maximum(worse, 0.0)), np.inf)
