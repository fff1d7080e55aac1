"""Offline objective as conservative Q-learning (Kumar et al. 2020) on the reward m."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.mdp.solve import bellman_reward
from socialiq.theory.fixed_point import centre
from socialiq.theory.objective import Problem


def conservative_loss(
    problem: Problem, q: Float[np.ndarray, "state action"], v: Float[np.ndarray, " state"]
) -> float:
    """Return τ E_E[-log π(a|s)] + κ E_E[(Q - γ E V(s') - m)²], CQL(H) with the reward m.

    It equals `Problem.loss` up to `offset`, at every Q. The same identity holds for networks, row
    by row (tests/identities/test_objective_identities.py).

    Args:
        problem: The problem.
        q: Q(s, a); read on the support only.
        v: V(s), the soft value of the demonstrated actions' Q.
    """
    support, weight = problem.support, problem.demonstrated[problem.support]
    surprise = (v[:, None] - q)[support]  # -τ log π(a|s)
    residual = (bellman_reward(problem.mdp, q, v, problem.discount) - centre(problem))[support]
    return float(weight @ (surprise + problem.curvature * residual**2))


def offset(problem: Problem) -> float:
    """Return (c w / κ) λ² E_E[T̄²], the constant by which the objective is larger."""
    support = problem.support
    square = problem.demonstrated[support] @ problem.target[support] ** 2
    scale = problem.chi2_coefficient * problem.prior_weight / problem.curvature
    return float(scale * problem.strength**2 * square)
