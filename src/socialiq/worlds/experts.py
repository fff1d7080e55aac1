"""Synthetic experts of thesis 5.2: exact value iteration at a social angle."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from socialiq.mdp.solve import greedy_policy, value_iteration
from socialiq.mdp.tabular import TabularMDP
from socialiq.social.angle import weights
from socialiq.social.score import score
from socialiq.worlds.enumerate import Table

Variant = Literal["deterministic", "stochastic"]


def expert_policy(
    table: Table, angle: float, variant: Variant = "deterministic", discount: float = 0.99
) -> Float[np.ndarray, "state action"]:
    """Return the greedy policy of value iteration on R(α) (Eq 4.3), one-hot.

    Ties go to the first action within a relative 1e-12, and cos 90° keeps its float64 residue:
    the 5x5 altruist of Fig 6.1 exists only because of both (docs/worlds/crossing5.md).

    Args:
        table: The world, with all its states.
        angle: Social angle in degrees.
        variant: Solve the world itself, or the variant without spawns, as the thesis does before
            it rolls the experts out in the stochastic world.
        discount: γ of Table C.1.
    """
    mdp = without_chance(table.mdp) if variant == "deterministic" else table.mdp
    reward = score(weights(angle), mdp.rewards)
    return greedy_policy(value_iteration(mdp, reward, discount).q)


def without_chance(mdp: TabularMDP) -> TabularMDP:
    """Return the variant in which the first chance outcome always occurs: no vehicle spawns.

    Rewards don't depend on the outcome in the gridworlds: a spawn affects later steps only.
    """
    certain = np.zeros_like(mdp.probability)
    certain[..., 0] = 1.0
    return dataclasses.replace(mdp, probability=certain)
