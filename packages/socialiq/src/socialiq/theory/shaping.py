"""Potential-based shaping, which changes no minimum, and targets without their shaping."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.mdp.tabular import TabularMDP
from socialiq.theory.objective import demonstrated_pairs

_ROUNDING = 1e-12  # of a least-squares fit, relative to the greatest target


class Orthogonal(NamedTuple):
    """Target without its shaping.

    Attributes:
        target: T_⊥ = T̄ + γ E Φ(s') - Φ(s) on the support, 0 elsewhere; reward.
        potential: The Φ that minimises the norm.
        norm: ‖T_⊥‖, the root of E_ρE[T_⊥²]; reward, and the root of ρ_E's mass.
    """

    target: Float[np.ndarray, "state action"]
    potential: Float[np.ndarray, " state"]
    norm: float


def shaped(
    mdp: TabularMDP,
    target: Float[np.ndarray, "state action"],
    potential: Float[np.ndarray, " state"],
    discount: float,
) -> Float[np.ndarray, "state action"]:
    """Return T + γ E Φ(s') - Φ(s), with Φ = 0 after an end (Ng et al. 1999).

    Args:
        mdp: The dynamics.
        target: T(s, a).
        potential: Φ(s).
        discount: γ.
    """
    return target + discount * mdp.expected_next(potential) - potential[:, None]


def orthogonal(
    mdp: TabularMDP,
    demonstrated: Float[np.ndarray, "state action"],
    target: Float[np.ndarray, "state action"],
    discount: float,
) -> Orthogonal:
    """Return the shaping of a target of least norm, by least squares with weights ρ_E.

    ρ_E T_⊥ then satisfies the homogeneous flow equations: occupancies can move along it.

    Args:
        mdp: The dynamics.
        demonstrated: ρ_E.
        target: T̄; read on the support only.
        discount: γ.
    """
    support = demonstrated_pairs(demonstrated)
    pairs = np.flatnonzero(support.ravel())
    states = np.flatnonzero(support.any(axis=1))
    steps = -discount * mdp.flow[pairs][:, states].toarray()
    steps[np.arange(len(pairs)), np.searchsorted(states, pairs // mdp.n_actions)] += 1.0
    root = np.sqrt(demonstrated.ravel()[pairs])
    goal = target.ravel()[pairs]
    solution = np.linalg.lstsq(root[:, None] * steps, root * goal, rcond=None)[0]
    left = goal - steps @ solution
    # Pure shaping leaves rounding errors, which would give flips at λ of 1e14.
    left[np.abs(left) <= _ROUNDING * np.abs(goal).max(initial=0.0)] = 0.0
    table, potential = np.zeros(target.size), np.zeros(mdp.n_states)
    table[pairs], potential[states] = left, solution
    norm = float(np.sqrt((root * left) @ (root * left)))
    return Orthogonal(table.reshape(target.shape), potential, norm)
