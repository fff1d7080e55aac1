"""A gridworld as a Gymnasium environment, from the arrays that `compare methods` writes.

Runs in the environment of another library: NumPy and Gymnasium 0.29 to 1.x, nothing of socialiq.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

NONE = 0
"""`ending` where the episode goes on."""


class TabularEnv(gymnasium.Env):
    """One finite MDP with a time limit; the reward is the pair, or 0 without it.

    Args:
        world: Named arrays of the MDP.
        vector: Whether the reward is the pair (r_env, r_social).
    """

    def __init__(self, world: Any, vector: bool = False) -> None:
        self.world, self.vector = {name: world[name] for name in _NAMES}, vector
        self.world["cumulative"] = self.world["probability"].cumsum(axis=2)
        observation = self.world["observation"]
        low, high = observation.min(axis=0) - 1.0, observation.max(axis=0) + 1.0
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Discrete(self.world["successor"].shape[1])
        # The name by which multi-objective libraries ask for it.
        self.reward_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float64)
        self.reward_dim = 2
        self.state, self.time = 0, 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        """Draw the first state."""
        super().reset(seed=seed, options=options)
        self.state = int(self.np_random.choice(len(self.world["initial"]), p=self.world["initial"]))
        self.time = 0
        return self.world["observation"][self.state], {}

    def step(self, action: Any) -> tuple[np.ndarray, Any, bool, bool, dict]:
        """Draw an outcome."""
        world, place = self.world, (self.state, int(action))
        drawn = int((self.np_random.random() >= world["cumulative"][place]).sum())
        outcome = min(drawn, world["probability"].shape[2] - 1)
        pair = np.array([world["r_env"][place], world["r_social"][place]])
        terminated = bool(world["ending"][(*place, outcome)] != NONE)
        self.state, self.time = int(world["successor"][(*place, outcome)]), self.time + 1
        truncated = self.time >= int(world["horizon"]) and not terminated
        reward = pair if self.vector else 0.0
        return world["observation"][self.state], reward, terminated, truncated, {}


_NAMES = ("successor", "probability", "ending", "r_env", "r_social")
_NAMES += ("initial", "observation", "horizon")
