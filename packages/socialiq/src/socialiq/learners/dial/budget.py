"""Strength by a budget: as much of the designer's score as needed, and the data for all else.

    min_π χ²(ρ_π, ρ_E)   subject to   J_α(π) >= J*_α - ε

The Lagrange multiplier μ of the constraint weighs the score (`train.weighed`). Dual ascent raises
it while the regret J*_α - J_α exceeds the budget ε, and lowers it below. The regret falls with μ
where the score is that of single steps, so there is one value to find. ε, in units of reward, is
what a designer declares and an auditor checks, in the place of λ.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.learners.state import Runs
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import network_of

Regret = Callable[[DialNetwork, int, float], float]
"""Function from a network, its run, and the multiplier of its training to the regret."""


ASCENT_EVERY = 250
"""Usual number of updates between two steps of dual ascent."""


class Look(NamedTuple):
    """History of the dual ascent.

    Attributes:
        updates: Gradient steps done.
        regret: Of each run.
        multiplier: Of each run, from here on.
    """

    updates: int
    regret: Float[np.ndarray, " run"]
    multiplier: Float[np.ndarray, " run"]


class Budget:
    """Dual ascent on the multiplier; pass it as `budget` of `train`.

    Args:
        regret: Measures a run's policy at the target angle.
        budget: ε of each run, in units of reward.
        step: How far log μ moves for a regret that is twice the budget.
        low: Smallest multiplier.
        high: Largest.

    Attributes:
        path: One `Look` for each chunk but the first, which learns at μ = 1.

    Raises:
        UserError: If a budget is not positive, or the range of multipliers is empty.
    """

    def __init__(
        self,
        regret: Regret,
        budget: Float[np.ndarray, " run"],
        step: float = 0.3,
        low: float = 1e-2,
        high: float = 1e3,
    ) -> None:
        if not (np.asarray(budget) > 0).all():
            raise UserError("a budget of regret must be above 0: an exact optimum is never certain")
        if not 0 < low < high:
            raise UserError(f"multipliers from {low:g} to {high:g}: give 0 < low < high")
        self._regret, self._budget = regret, np.asarray(budget, np.float64)
        self._step, self._low, self._high = step, low, high
        self.path: list[Look] = []

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Measure every run, and move its multiplier."""
        before = np.asarray(runs.carry.multiplier, np.float64)
        if not done:
            return runs
        networks = runs.state.target_network.values
        regret = np.array(
            [
                self._regret(network_of(networks, run), run, float(multiplier))
                for run, multiplier in enumerate(before)
            ]
        )
        # Bounded: far from the budget every step is as long as any.
        excess = np.clip(regret / self._budget - 1.0, -1.0, 1.0)
        after = np.clip(before * np.exp(self._step * excess), self._low, self._high)
        self.path.append(Look(done, regret, after))
        moved = runs.carry._replace(multiplier=jnp.asarray(after, jnp.float32))
        return runs._replace(carry=moved)
