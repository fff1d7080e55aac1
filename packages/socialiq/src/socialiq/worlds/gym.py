"""Gridworlds as Gymnasium environments; `worlds.IDS` has their ids."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from socialiq.foreign import Later
from socialiq.social.angle import check_angle, score, weights
from socialiq.types import Ending
from socialiq.worlds import registry
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.pictures import picture, pixels

jax: Any = Later("jax")


class GridWorldEnv(gymnasium.Env):
    """Gridworld with the Gymnasium interface; every number comes from the world's rules.

    The scalar reward is R(α) (Eq 4.3) at the given angle. `info` has `reward_pair`
    (r_env, r_social), `signals` (every named signal), `ending` (its name) and the ego's `speed`.

    Args:
        world: Name of the world.
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: "rgb_array" or None.
        clock: Whether observations end with the time.
        options: Options of the world, as for `worlds.registry.make`.

    Raises:
        UserError: If the world or an option is unknown, or the angle is invalid.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self,
        world: str = "crossing7",
        angle: float = 0.0,
        render_mode: str | None = None,
        clock: bool = False,
        **options: Any,
    ) -> None:
        plain = registry.make_grid(world, **options)
        self.world: GridWorld = plain.with_clock() if clock else plain
        self.render_mode = render_mode
        self._weights = weights(check_angle(angle))
        low = np.array([feature.low for feature in self.world.observed], np.float32)
        high = low + np.array([feature.size for feature in self.world.observed], np.float32) - 1
        low[low == high] = 0.0  # Gymnasium warns of features that never change
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.action_space = spaces.Discrete(self.world.n_actions)
        self._state = np.zeros(len(self.world.features), np.int32)
        self._time = 0

    @cached_property
    def _rules(self) -> Any:
        return jax.jit(self.world.rules)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        super().reset(seed=seed, options=options)
        chosen = self.np_random.choice(len(self.world.start), p=[p for _, p in self.world.start])
        self._state = np.array(self.world.start[chosen][0], np.int32)
        self._time = 0
        return self._observation(), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one step. The horizon truncates; every other ending terminates."""
        chance = self.np_random.choice(len(self.world.chance), p=self.world.chance)
        outcome = self._rules(self._state, int(action), int(chance))
        self._state = np.asarray(outcome.state)
        self._time += 1
        ending = Ending(int(outcome.ending))
        if ending == Ending.NONE and self._time >= self.world.horizon:
            ending = Ending.TIMEOUT
        signals = {name: float(value) for name, value in outcome.signals.items()}
        rewards = self.world.rewards(signals)
        info = {
            "reward_pair": np.array(rewards, np.float64),
            "signals": signals,
            "ending": ending.name.lower(),
            "speed": float(outcome.speed),
        }
        return (
            self._observation(),
            float(score(self._weights, rewards)),
            ending not in (Ending.NONE, Ending.TIMEOUT),
            ending == Ending.TIMEOUT,
            info,
        )

    def _observation(self) -> np.ndarray:
        features = np.append(self._state, self._time) if self.world.clock else self._state
        return features.astype(np.float32)

    def render(self) -> np.ndarray | None:
        """Return a picture of the current state, uint8 (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        return pixels(picture(self.world, self._state.tolist()))
