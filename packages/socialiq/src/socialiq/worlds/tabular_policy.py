"""Tabular policies, and the exact synthetic experts of thesis 5.2."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from socialiq.mdp.solve import greedy_policy, value_iteration
from socialiq.mdp.tabular import TabularMDP
from socialiq.social.angle import score, weights
from socialiq.worlds.enumerate import Table
from socialiq.worlds.grid_world import GridWorld


@dataclass(frozen=True)
class TabularPolicy:
    """Action probabilities by state, in the order of the world's state numbers.

    Attributes:
        world: The world.
        probabilities: Of each action in each state.
        rng: Source of the draws.
    """

    world: GridWorld
    probabilities: Float[np.ndarray, "state action"]
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions: the most probable (the first of equals), or drawn from the table."""
        batch = np.atleast_2d(np.rint(observation).astype(np.int64))
        chances = self.probabilities[self.world.index(batch)]
        actions = chances.argmax(axis=1) if deterministic else draw_actions(chances, self.rng)
        return actions.reshape(np.shape(observation)[:-1]), state


def draw_actions(
    probabilities: Float[np.ndarray, "batch action"], rng: np.random.Generator
) -> np.ndarray:
    """Draw one action for each row of probabilities."""
    cumulative = probabilities.cumsum(axis=1)
    drawn = (rng.random((len(probabilities), 1)) >= cumulative).sum(axis=1)
    return np.minimum(drawn, probabilities.shape[1] - 1)


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
