"""Exact regularized objective of Eq 4.5 on a finite MDP, and targets without their shaping."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from socialiq.errors import UserError
from socialiq.mdp.solve import bellman_reward
from socialiq.mdp.tabular import StateActionArray, StateArray, TabularMDP, check_reward

# Relative to the first states' mass; an exact occupancy differs by rounding only.
_FLOW_TOLERANCE = 1e-9
# Relative to the largest occupancy; smaller values are rounding errors.
_DUST = 1e-14


@dataclass(frozen=True, eq=False)
class Problem:
    """Problem of minimising L_IQ + w L_reg over tables Q, with exact measures (Eq 2.7, 4.4, 4.5).

    ρ_E must satisfy the flow equations of the MDP, because every theorem here depends on it. Its
    scale is free. Uniformly drawn rows of episodes are an occupancy of a modified MDP
    (`theory.demonstrators`).

    Raises:
        UserError: If a number is out of range, or ρ_E is not an occupancy of the MDP.
    """

    mdp: TabularMDP  # the dynamics
    demonstrated: StateActionArray  # ρ_E(s, a), the demonstrators' discounted occupancy
    # T̄(s, a), the mean target of the prior, reward; read where ρ_E > 0 only
    target: StateActionArray
    strength: float = 1.0  # λ >= 0 of Eq 4.4
    discount: float = 0.99  # γ in [0, 1)
    temperature: float = 1.0  # τ > 0 of Eq 2.5, in units of reward
    chi2_alpha: float = 0.5  # α_χ > 0 of Eq 2.7
    prior_weight: float = 1.0  # w >= 0 of Eq 4.5

    def __post_init__(self) -> None:
        for name in ("strength", "prior_weight"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise UserError(f"{name} must be 0 or more, got {getattr(self, name)}")
        for name in ("temperature", "chi2_alpha"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise UserError(f"{name} must be above 0, got {getattr(self, name)}")
        if not 0.0 <= self.discount < 1.0:
            raise UserError(f"discount must lie in [0, 1), got {self.discount}")
        check_reward(self.mdp, self.target, "target")
        _check_occupancy(self.mdp, self.demonstrated, self.discount)

    @property
    def chi2_coefficient(self) -> float:
        """Coefficient c = 1 / (4 α_χ) of E_E[r̂²] in Eq 2.7."""
        return 1.0 / (4.0 * self.chi2_alpha)

    @property
    def curvature(self) -> float:
        """Coefficient κ = c + w of the sum of both quadratic terms."""
        return self.chi2_coefficient + self.prior_weight

    @property
    def support(self) -> Bool[np.ndarray, "state action"]:
        """Whether each (state, action) is demonstrated."""
        return demonstrated_pairs(self.demonstrated)

    @property
    def entry(self) -> StateArray:
        """Weight (1 - γ) p_0(s) of V(s) in term 2 of Eq 2.7, with the scale of ρ_E."""
        scale = entry_mass(self.mdp, self.demonstrated, self.discount).sum()
        return scale * self.mdp.initial

    def loss(self, q: StateActionArray, v: StateArray) -> float:
        """Return -E_E[r̂] + (1 - γ) E_p0[V] + c E_E[r̂²] + w E_E[(r̂ - λ T̄)²] (Eq 4.5).

        The square is that of the mean r̂ of (s, a). With random transitions, rows of a data
        set have the mean of squares, which is larger by γ² Var[V(s')] (docs/theory.md).

        Args:
            q: Q(s, a), read on the support only.
            v: V(s), the soft value of the demonstrated actions' Q.

        Returns:
            The loss, with the scale of ρ_E.
        """
        support = self.support
        weight = self.demonstrated
        reward = bellman_reward(self.mdp, q, v, self.discount)[support]
        gap = reward - self.strength * self.target[support]
        quadratics = self.chi2_coefficient * reward**2 + self.prior_weight * gap**2
        return float(weight[support] @ (quadratics - reward) + self.entry @ v)


def demonstrated_pairs(demonstrated: StateActionArray) -> Bool[np.ndarray, "state action"]:
    """Return where ρ_E > 0, ignoring rounding errors of a linear system."""
    return demonstrated > _DUST * demonstrated.max()


def entry_mass(mdp: TabularMDP, occupancy: StateActionArray, discount: float) -> StateArray:
    """Return Σ_a ρ(s, a) - γ Σ P(s | s', a') ρ(s', a'), the mass that starts in s.

    For an occupancy it is (1 - γ) p_0(s) times the occupancy's scale.

    Args:
        mdp: The MDP.
        occupancy: ρ(s, a), of any scale.
        discount: γ.

    Returns:
        The mass of each state, at least 0 up to rounding if ρ is an occupancy.
    """
    return occupancy.sum(axis=1) - discount * mdp.arrivals(occupancy)


def _check_occupancy(mdp: TabularMDP, occupancy: StateActionArray, discount: float) -> None:
    """Refuse a measure that is not a discounted occupancy of the MDP, of any scale."""
    check_reward(mdp, occupancy, "occupancy")
    if occupancy.min() < 0.0 or not occupancy.any():
        raise UserError("an occupancy has no negative numbers, and some positive one")
    entered = entry_mass(mdp, occupancy, discount)
    error = np.abs(entered - entered.sum() * mdp.initial).max()
    if error > _FLOW_TOLERANCE * entered.sum():
        raise UserError(
            f"this is not an occupancy of the MDP: its flow is off by {error:.3g}; "
            "make it by mdp.solve.discounted_occupancy, or by theory.demonstrators"
        )


_ROUNDING = 1e-12  # of a least-squares fit, relative to the greatest target


class Orthogonal(NamedTuple):
    """Target without its shaping."""

    target: StateActionArray  # T_⊥ = T̄ + γ E Φ(s') - Φ(s) on the support, 0 elsewhere; reward
    potential: StateArray  # the Φ that minimises the norm
    norm: float  # ‖T_⊥‖, the root of E_ρE[T_⊥²]; reward, and the root of ρ_E's mass


def shaped(
    mdp: TabularMDP, target: StateActionArray, potential: StateArray, discount: float
) -> StateActionArray:
    """Return T + γ E Φ(s') - Φ(s), with Φ = 0 after an end (Ng et al. 1999): shaping of a target.

    It changes no minimum.

    Args:
        mdp: The MDP.
        target: T(s, a), in units of reward.
        potential: Φ(s), in units of reward.
        discount: γ.

    Returns:
        The shaped target of each (state, action).
    """
    return target + discount * mdp.expected_next(potential) - potential[:, None]


def orthogonal(
    mdp: TabularMDP, demonstrated: StateActionArray, target: StateActionArray, discount: float
) -> Orthogonal:
    """Return the shaping of a target of least norm, by least squares with weights ρ_E.

    ρ_E T_⊥ then satisfies the homogeneous flow equations: occupancies can move along it.

    Args:
        mdp: The MDP.
        demonstrated: ρ_E(s, a), of any scale.
        target: T̄(s, a), read on the support only.
        discount: γ.

    Returns:
        T_⊥, the potential that leads to it, and the norm of T_⊥.
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
    table = np.zeros(target.size)
    potential = np.zeros(mdp.n_states)
    table[pairs] = left
    potential[states] = solution
    norm = float(np.sqrt((root * left) @ (root * left)))
    return Orthogonal(table.reshape(target.shape), potential, norm)
