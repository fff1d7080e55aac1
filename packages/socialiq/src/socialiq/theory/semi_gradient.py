"""Analogue of the theory for V(s') of a target network, through which no gradient passes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.mdp.solve import evaluate_policy
from socialiq.theory.objective import Problem
from socialiq.theory.support import Point, Support, Vector

_MAX_STEPS = 200


def demonstrated_policy(problem: Problem) -> Float[np.ndarray, "state action"]:
    """Return π_E(a|s) = ρ_E(s, a) / ρ_E(s); 0 in states that are not demonstrated."""
    level = np.where(problem.support, problem.demonstrated, 0.0)
    seen = level.sum(axis=1, keepdims=True)
    return level / np.where(seen > 0.0, seen, 1.0)


def pooled_advantage(problem: Problem) -> Float[np.ndarray, "state action"]:
    """Return A(s, a) of the target under the demonstrators' pooled policy; 0 off the support."""
    policy = demonstrated_policy(problem)
    closed = np.where(policy.sum(axis=1, keepdims=True) > 0.0, policy, 1.0 / policy.shape[1])
    target = np.where(problem.support, problem.target, 0.0)
    known = evaluate_policy(problem.mdp, closed, target, problem.discount)
    return np.where(problem.support, known.q - known.v[:, None], 0.0)


def policy_slope(problem: Problem) -> Float[np.ndarray, "state action"]:
    """Return dπ(a|s)/dλ = 2 w π_E A, valid until an action has probability 0, as τ → 0.

    With the gradient of V(s) alone the fixed point is r̂ = m + [1 - π / π_E] / (2κ). As τ → 0 the
    actions in use have Q = V, hence π = π_E [1 + 2κ (m + γ E V(s') - V(s))]. As π sums to 1
    in each state, V is the value of π_E on the reward m.
    """
    return 2.0 * problem.prior_weight * demonstrated_policy(problem) * pooled_advantage(problem)


def fixed_point(
    problem: Problem,
    start: Float[np.ndarray, "state action"] | None = None,
    weight: Float[np.ndarray, " state"] | None = None,
) -> Float[np.ndarray, "state action"]:
    """Return the Q at which the semi-gradient of the offline objective is 0 (`value_expert`).

    r̂ = m + [1 - π / π_E] / (2κ) with π = softmax(Q / τ). Given V(s') each state has a monotone
    equation, and V is a γ-contraction, so the fixed point is unique. Newton's method finds it.

    Args:
        problem: The problem; only the shares of actions of `demonstrated` matter.
        start: Q at the fixed point of a similar problem on the same support.
        weight: μ(s) / ρ_E(s), by default 1, with μ(s) the share of s among the rows of term 2; it
            multiplies π above.

    Returns:
        Q(s, a), -inf off the support.

    Raises:
        UserError: If Newton's method doesn't converge.
    """
    support = Support(problem)
    shares = support.weight / support.total(support.weight)
    if weight is not None:
        shares = shares / weight[support.states][support.state]

    def solve(q: Vector, temperature: float, tolerance: float) -> Point:
        return _newton(support, q, temperature, shares, tolerance)

    return support.table(support.follow(solve, start).q, -np.inf)


def _newton(
    support: Support, q: Vector, temperature: float, shares: Vector, tolerance: float
) -> Point:
    """Run Newton's method for the fixed point, halving steps that increase the residual."""
    twice = 2.0 * support.problem.curvature
    point = support.at(q, temperature)
    gap = (support.slope(point.reward) + point.pi / shares) / twice
    for _ in range(_MAX_STEPS):
        if np.abs(gap).max() <= tolerance:
            return point
        averages = support.averages(point.pi)
        spread = np.diag(point.pi) - averages.T @ averages
        matrix = np.eye(len(q)) - support.problem.discount * (support.flow @ averages)
        matrix += spread / (twice * temperature * shares)[:, None]
        direction = -np.linalg.solve(matrix, gap)
        size = 1.0
        while True:
            found = support.at(point.q + size * direction, temperature)
            left = (support.slope(found.reward) + found.pi / shares) / twice
            if np.linalg.norm(left) < (1.0 - 1e-4 * size) * np.linalg.norm(gap) or size < 1e-9:
                break
            size /= 2.0
        point, gap = found, left
    raise UserError(
        f"the fixed point is still off by {np.abs(gap).max():.3g} after {_MAX_STEPS} steps at "
        f"temperature {temperature:g}: raise the temperature, or lower the strength"
    )
