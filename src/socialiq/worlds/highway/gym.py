"""A scene as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from socialiq.social.angle import check_angle, score, weights
from socialiq.types import Ending
from socialiq.worlds.highway.batch import Batch
from socialiq.worlds.highway.state import ACTIONS


class SceneEnv(gymnasium.Env):
    """Scene of highway-env with the reward pair of the intersection.

    The scalar reward is R(α) (Eq 4.3) at the given angle. `info` has `reward_pair`
    (r_env, r_social), `signals` (every named signal, unweighted), `ending` (its name) and the ego's
    `speed` in m/s.

    Args:
        scene: Name of the scene.
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: None.
        options: Values by name, of `options.NAMES`.

    Raises:
        UserError: If the scene or an option is unknown, or the angle is invalid.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self, scene: str, angle: float = 0.0, render_mode: str | None = None, **options: Any
    ) -> None:
        self.render_mode = render_mode
        self._weights = weights(check_angle(angle))
        self.batch = Batch(scene, 1, **options)
        features = self.batch.observation.shape[1]
        self.observation_space = spaces.Box(-1.0, 1.0, (features,), np.float32)
        self.action_space = spaces.Discrete(len(ACTIONS))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start the episode that highway-env starts with this seed, or continue the stream."""
        super().reset(seed=seed, options=options)
        if seed is None and not self.batch.begun.all():
            seed = int(self.np_random.integers(2**31))
        return self.batch.reset(None if seed is None else [seed])[0], {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one decision. A timeout truncates; every other ending terminates."""
        made = self.batch.step(np.array([int(action)]), auto_reset=False)
        ending = Ending(int(made.ending[0]))
        info = {
            "reward_pair": np.array([made.rewards.env[0], made.rewards.social[0]]),
            "signals": {name: float(values[0]) for name, values in made.signals.items()},
            "ending": ending.name.lower(),
            "speed": float(made.speed[0]),
        }
        reward = float(score(self._weights, made.rewards)[0])
        terminated = ending in (Ending.ARRIVAL, Ending.COLLISION)
        return made.observation[0], reward, terminated, ending == Ending.TIMEOUT, info
