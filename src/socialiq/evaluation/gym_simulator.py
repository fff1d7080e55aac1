"""A Gymnasium environment as a back end of `simulate`."""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from jaxtyping import Int64

from socialiq.errors import UserError
from socialiq.types import Ending, Policy, RewardPair

MOST_STEPS = 100_000
"""Of an episode; without a time limit it might never end."""


class GymStep(NamedTuple):
    """Result of a step in a Gymnasium environment.

    Attributes:
        observation: The next one.
        rewards: Of the step.
        ending: Value of `Ending`, in an array of one.
        speed: The ego's, NaN if it is not told.
    """

    observation: Any
    rewards: RewardPair
    ending: Int64[np.ndarray, " 1"]
    speed: float


class GymSimulator:
    """A Gymnasium environment as a back end of `simulate`: one row.

    Args:
        env: With discrete actions.
        modulus: Of the seeds with which it is reset: not all environments take large ones.

    Raises:
        UserError: If the actions are not discrete; in `step`, if an episode doesn't end.
    """

    size = 1

    def __init__(self, env: gymnasium.Env[Any, Any], modulus: int | None = None) -> None:
        if not isinstance(env.action_space, gymnasium.spaces.Discrete):
            raise UserError("only discrete actions are supported: wrap the environment")
        self._env, self._modulus = env, modulus
        self._seen, self._length = None, 0

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:  # noqa: ARG002
        """Reset the environment."""
        seed = int(seeds[0])
        self._seen, _ = self._env.reset(seed=seed % self._modulus if self._modulus else seed)
        self._length = 0

    def observe(self) -> list[Any]:
        """Return the observation as the environment gave it, in a list of one."""
        return [self._seen]

    def step(self, action: np.ndarray, running: np.ndarray) -> GymStep:  # noqa: ARG002
        """Take a step."""
        if self._length == MOST_STEPS:
            raise UserError(
                f"an episode has not ended after {MOST_STEPS:,} steps: wrap the environment "
                "in gymnasium.wrappers.TimeLimit"
            )
        after, reward, terminated, truncated, info = self._env.step(int(action[0]))
        ending = Ending.of_step(terminated, truncated, info)
        pair, speed = RewardPair.of_step(reward, info), float(info.get("speed", np.nan))
        self._seen, self._length = after, self._length + 1
        return GymStep(after, pair, np.array([int(ending)]), speed)


class GymActor:
    """A policy that sees one observation at a time and may keep a state within an episode."""

    def __init__(self, policy: Policy, deterministic: bool) -> None:
        self._policy, self._deterministic, self._state = policy, deterministic, None

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:  # noqa: ARG002
        """Forget the last episode."""
        self._state = None

    def decide(self, observation: list[Any], running: np.ndarray) -> Int64[np.ndarray, " 1"]:  # noqa: ARG002
        """Ask the policy."""
        action, self._state = self._policy.predict(
            observation[0], self._state, deterministic=self._deterministic
        )
        return np.array([int(action)])
