"""Primal problem over policies, which the minimum of the loss maximises."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.special import entr

from socialiq.theory.fixed_point import centre
from socialiq.theory.objective import Problem
from socialiq.theory.offline import offset


def chi2_distance(problem: Problem, occupancy: Float[np.ndarray, "state action"]) -> float:
    """Return χ²(ρ, ρ_E) = Σ (ρ - ρ_E)² / ρ_E; infinite if ρ leaves the support of ρ_E."""
    support = problem.support
    if occupancy[~support].any():
        return float("inf")
    expected = problem.demonstrated[support]
    return float(((occupancy[support] - expected) ** 2 / expected).sum())


def occupancy_entropy(occupancy: Float[np.ndarray, "state action"]) -> float:
    """Return H = -Σ ρ(s, a) log π(a|s), discounted causal entropy times (1 - γ), in nats."""
    return float(entr(occupancy).sum() - entr(occupancy.sum(axis=1)).sum())


def primal_value(problem: Problem, occupancy: Float[np.ndarray, "state action"]) -> float:
    """Return 4 w λ E_ρ[T̄] - χ²(ρ, ρ_E) + 4 κ τ H(ρ), maximised by the minimum's policy.

    The loss is the maximum over π of -E_E[r] + E_π[r] + τ H + κ E_E[(r - m)²] + constant. The
    minimum of this over r is E_π[m] - E_E[m] + τ H - χ² / (4κ). The value is this times 4κ,
    without the constants.

    Args:
        problem: The problem.
        occupancy: ρ of any policy, with the scale of ρ_E.
    """
    support = problem.support
    earned = float(occupancy[support] @ problem.target[support])
    steering = 4.0 * problem.prior_weight * problem.strength * earned
    entropy = 4.0 * problem.curvature * problem.temperature * occupancy_entropy(occupancy)
    return steering - chi2_distance(problem, occupancy) + entropy


def dual_value(problem: Problem, loss: float) -> float:
    """Return 4κ (loss + E_E[m]) without the constant of the square, a bound of `primal_value`.

    It is at least every policy's primal value, with equality only at the minimum: a certificate.

    Args:
        problem: The problem.
        loss: `Problem.loss` at any Q.
    """
    support = problem.support
    relabelled = float(problem.demonstrated[support] @ centre(problem)[support])
    return 4.0 * problem.curvature * (loss - offset(problem) + relabelled)
