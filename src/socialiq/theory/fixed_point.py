"""Implicit reward at the minimum, in closed form."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.theory.objective import Problem


def centre(problem: Problem) -> Float[np.ndarray, "state action"]:
    """Return m = w λ T̄ / (c + w), the centre of the sum of both quadratic terms, reward.

    c r² + w (r - λT)² = κ (r - m)² + constant, with κ = c + w. With the thesis' constants
    m = (2/3) λ T̄.
    """
    share = problem.prior_weight / problem.curvature
    return share * problem.strength * problem.target


def closed_form(
    problem: Problem, occupancy: Float[np.ndarray, "state action"]
) -> Float[np.ndarray, "state action"]:
    """Return r̂(s, a) = m + [1 - ρ_π(s, a) / ρ_E(s, a)] / (2κ), the reward at the minimum.

    It follows from the derivative of the loss by r̂(s, a), where that of (1 - γ) E_p0[V] is
    ρ_π(s, a). Without a prior it is the χ² fixed point of Garg et al. 2021. Pairs that are not
    demonstrated have no minimum: r̂ tends to -inf there.

    Args:
        problem: The problem.
        occupancy: ρ_π of the policy at the minimum, with the scale of ρ_E.
    """
    support = problem.support
    ratio = occupancy / np.where(support, problem.demonstrated, 1.0)
    reward = centre(problem) + (1.0 - ratio) / (2.0 * problem.curvature)
    return np.where(support, reward, -np.inf)
