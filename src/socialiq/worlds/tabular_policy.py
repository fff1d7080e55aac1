"""Policy given by a table: one distribution over actions for each state of a gridworld."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

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
