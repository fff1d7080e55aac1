"""How a DQN of Stable-Baselines3 draws when it is not asked for its best action."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.nn.q_policy import QPolicy


@dataclass(frozen=True)
class EpsilonGreedy:
    """The best action, or with probability ε one drawn evenly from all.

    Stable-Baselines3 throws one coin for all observations of a call; here every observation has
    its own, so that episodes don't depend on the batch. Of a single observation the distribution
    is the same.

    Attributes:
        greedy: Says what is best.
        epsilon: ε, in [0, 1].
        rng: Source of the draws.
    """

    greedy: QPolicy
    epsilon: float
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Probability of each action."""
        best = self.greedy.q_values(observations).argmax(axis=1)
        n_actions = self.greedy.n_actions
        return (1.0 - self.epsilon) * np.eye(n_actions)[best] + self.epsilon / n_actions

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions for one observation, shape (features,), or a batch (batch, features).

        Raises:
            UserError: If an observation has another length or is not finite.
        """
        best, state = self.greedy.predict(observation, state, episode_start)
        if deterministic:
            return best, state
        explores = self.rng.random(best.shape) < self.epsilon
        drawn = self.rng.integers(self.greedy.n_actions, size=best.shape)
        return np.where(explores, drawn, best), state
