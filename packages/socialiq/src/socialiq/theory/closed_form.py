"""Closed forms of the minimum: implicit reward, offline objective, and primal problem.

The offline objective is conservative Q-learning (Kumar et al. 2020) on the reward m, the centre of
the sum of both quadratic terms. The minimum of the loss maximises the primal value over policies.
"""

from __future__ import annotations

import numpy as np
from scipy.special import entr

from socialiq.mdp.solve import bellman_reward
from socialiq.mdp.tabular import StateActionArray, StateArray
from socialiq.theory.objective import Problem


def centre(problem: Problem) -> StateActionArray:
    """Return m = w λ T̄ / (c + w), the centre of the sum of both quadratic terms, reward.

    c r² + w (r - λT)² = κ (r - m)² + constant, with κ = c + w. With the thesis' constants
    m = (2/3) λ T̄.
    """
    share = problem.prior_weight / problem.curvature
    return share * problem.strength * problem.target


def closed_form(problem: Problem, occupancy: StateActionArray) -> StateActionArray:
    """Return r̂(s, a) = m + [1 - ρ_π(s, a) / ρ_E(s, a)] / (2κ), the reward at the minimum.

    It follows from the derivative of the loss by r̂(s, a), where that of (1 - γ) E_p0[V] is
    ρ_π(s, a). Without a prior it is the χ² fixed point of Garg et al. 2021.

    Args:
        problem: The objective, with its exact measures.
        occupancy: ρ_π(s, a) of the policy at the minimum, with the scale of ρ_E.

    Returns:
        r̂ of each (state, action), in units of reward. It is -inf for pairs that are not
        demonstrated: they have no minimum, and r̂ tends to -inf.
    """
    support = problem.support
    ratio = occupancy / np.where(support, problem.demonstrated, 1.0)
    reward = centre(problem) + (1.0 - ratio) / (2.0 * problem.curvature)
    return np.where(support, reward, -np.inf)


def conservative_loss(problem: Problem, q: StateActionArray, v: StateArray) -> float:
    """Return τ E_E[-log π(a|s)] + κ E_E[(Q - γ E V(s') - m)²], CQL(H) with the reward m.

    It equals `Problem.loss` up to `offset`, at every Q, with the same arguments. The same identity
    holds for networks, row by row (tests/identities/test_objective_identities.py).

    Args:
        problem: The objective, with its exact measures.
        q: Q(s, a), read on the support only.
        v: V(s), the soft value of the demonstrated actions' Q.

    Returns:
        The loss, which is lower than `Problem.loss` by `offset`.
    """
    support = problem.support
    weight = problem.demonstrated[problem.support]
    surprise = (v[:, None] - q)[support]  # -τ log π(a|s)
    residual = (bellman_reward(problem.mdp, q, v, problem.discount) - centre(problem))[support]
    return float(weight @ (surprise + problem.curvature * residual**2))


def offset(problem: Problem) -> float:
    """Return (c w / κ) λ² E_E[T̄²], the constant by which the objective is larger."""
    support = problem.support
    square = problem.demonstrated[support] @ problem.target[support] ** 2
    scale = problem.chi2_coefficient * problem.prior_weight / problem.curvature
    return float(scale * problem.strength**2 * square)


def chi2_distance(problem: Problem, occupancy: StateActionArray) -> float:
    """Return χ²(ρ, ρ_E) = Σ (ρ - ρ_E)² / ρ_E.

    Args:
        problem: The problem whose demonstrated occupancy is ρ_E.
        occupancy: ρ(s, a), with the scale of ρ_E.

    Returns:
        The distance, summed over the support of ρ_E; infinite if ρ leaves the support.
    """
    support = problem.support
    if occupancy[~support].any():
        return float("inf")
    expected = problem.demonstrated[support]
    return float(((occupancy[support] - expected) ** 2 / expected).sum())


def occupancy_entropy(occupancy: StateActionArray) -> float:
    """Return H = -Σ ρ(s, a) log π(a|s), discounted causal entropy times (1 - γ), in nats."""
    return float(entr(occupancy).sum() - entr(occupancy.sum(axis=1)).sum())


def primal_value(problem: Problem, occupancy: StateActionArray) -> float:
    """Return 4 w λ E_ρ[T̄] - χ²(ρ, ρ_E) + 4 κ τ H(ρ), maximised by the minimum's policy.

    The loss is the maximum over π of -E_E[r] + E_π[r] + τ H + κ E_E[(r - m)²] + constant. The
    minimum of this over r is E_π[m] - E_E[m] + τ H - χ² / (4κ). The value is this times 4κ,
    without the constants.

    Args:
        problem: The objective, with its exact measures.
        occupancy: ρ(s, a) of any policy, with the scale of ρ_E.

    Returns:
        The value; -inf if the occupancy leaves the support of ρ_E.
    """
    support = problem.support
    earned = float(occupancy[support] @ problem.target[support])
    steering = 4.0 * problem.prior_weight * problem.strength * earned
    entropy = 4.0 * problem.curvature * problem.temperature * occupancy_entropy(occupancy)
    return steering - chi2_distance(problem, occupancy) + entropy


def dual_value(problem: Problem, loss: float) -> float:
    """Return 4κ (loss + E_E[m]) without the constant of the square, a bound of `primal_value`.

    Args:
        problem: The objective, with its exact measures.
        loss: `Problem.loss` at any Q.

    Returns:
        A number that is at least every policy's primal value, with equality only at the minimum: a
        certificate.
    """
    support = problem.support
    relabelled = float(problem.demonstrated[support] @ centre(problem)[support])
    return 4.0 * problem.curvature * (loss - offset(problem) + relabelled)
