"""Terminal states as states that are never left, which the observation shows.

The learner then finds their value as it finds others (Kostrikov et al. 2019).
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.worlds.wrapper import flat, flat_space


class AbsorbingStates(gymnasium.Wrapper):
    """Environment in which a terminal state is followed by one that is never left.

    Observations are flat, float32, and one longer: the last number is 0, and 1 in the absorbing
    state, where the others are 0. A step that would terminate leads there; `stay` steps in it
    follow, with reward 0 and whatever action, then the episode is truncated. Time limits stay as
    they are. A learner that bootstraps through them values the absorbing state by itself, of the
    demonstrations' and its own alike. r_env and r_social of the steps there are 0.

    Args:
        env: With observations that are arrays (`spaces.Box`).
        stay: Steps in the absorbing state, at least 1.

    Raises:
        UserError: If `stay` is below 1, or observations are of another kind.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], stay: int = 1) -> None:
        if stay < 1:
            raise UserError(f"stay must be at least 1, got {stay}")
        super().__init__(env)
        inner = flat_space(env.observation_space)
        low, high = (np.minimum(inner.low, 0.0), np.maximum(inner.high, 0.0))
        low, high = np.append(low, np.float32(0)), np.append(high, np.float32(1))
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.stay = stay
        self._left: int | None = None  # steps left in the absorbing state; None outside it

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        self._left = None
        observation, info = self.env.reset(seed=seed, options=options)
        return marked(observation), info

    def step(self, action: Any) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """Take one step, or stay in the absorbing state."""
        if self._left is not None:
            self._left -= 1
            return self._absorbed, 0.0, False, self._left == 0, {"reward_pair": np.zeros(2)}
        observation, reward, terminated, truncated, info = self.env.step(action)
        if terminated:
            self._left = self.stay
            return self._absorbed, reward, False, False, info
        return marked(observation), reward, terminated, truncated, info

    @property
    def _absorbed(self) -> np.ndarray:
        space = self.observation_space
        assert space.shape is not None
        state = np.zeros(space.shape, np.float32)
        state[-1] = 1.0
        return state


def marked(observation: Any) -> np.ndarray:
    """Return an observation outside the absorbing state: flat, float32, with a 0 at its end."""
    return np.append(flat(observation), np.float32(0.0))
