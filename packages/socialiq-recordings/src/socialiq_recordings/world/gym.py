"""Recorded junction as a Gymnasium environment."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.social.angle import check_angle, score, weights
from socialiq.types import Ending
from socialiq.worlds.highway.options import Contact
from socialiq_recordings.world.batch import JunctionBatch
from socialiq_recordings.world.recorded_world import RecordedWorld

_TERMINAL = (int(Ending.ARRIVAL), int(Ending.COLLISION), int(Ending.OTHER))


class RecordedJunctionEnv(gymnasium.Env):
    """Recorded junction with the Gymnasium interface.

    The ego takes the place of a recorded vehicle at a recorded moment, both drawn by the seed, and
    drives its way. The others are drivers of the calibrated population; they start as recorded,
    enter where and when the recorded ones did, and react. The scalar reward is R(α) (Eq 4.3).

    `info` has `reward_pair` (r_env, r_social), `signals` (every named signal, unweighted), `ending`
    (arrival, collision, timeout, or other: over a closed line), the ego's `speed` in m/s, `contact`
    (which vehicle struck), and in that of `reset` the `recording` and `vehicle` of its place.

    Args:
        file: World of `socialiq data world`.
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: "rgb_array" or None.
        clock: Whether observations end with the time, in decisions since the reset.
        sha256: Of the world's content, if it must be a certain one.

    Raises:
        UserError: If the file is no world or another one, or the angle is invalid.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self,
        file: str | Path = "",
        angle: float = 0.0,
        render_mode: str | None = None,
        clock: bool = False,
        sha256: str = "",
    ) -> None:
        self.world = load_world(file)
        if sha256 and sha256 != self.world.sha256:
            raise UserError(f"{file} is not the world with the SHA-256 {sha256[:12]}...")
        self.render_mode = render_mode
        self._weights = weights(check_angle(angle))
        self._clock = clock
        self.batch = JunctionBatch(self.world, 1)
        decisions = int(self.world.config.duration * self.world.config.policy_rate)
        low, high = (np.full(self.world.n_features + clock, end, np.float32) for end in (-1.0, 1.0))
        if clock:
            low[-1], high[-1] = 0.0, decisions + 1
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.action_space = spaces.Discrete(self.world.n_actions)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        super().reset(seed=seed, options=options)
        if seed is None and not self.batch.begun.all():
            seed = int(self.np_random.integers(2**31))
        observation = self.batch.reset(None if seed is None else [seed])
        return self._seen(observation), self._place()

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one decision. A timeout truncates; every other ending terminates."""
        decisions = self.batch.step(np.array([int(action)]))
        ending = int(decisions.ending[0])
        info = {
            "reward_pair": np.array([decisions.rewards.env[0], decisions.rewards.social[0]]),
            "signals": {name: float(values[0]) for name, values in decisions.signals.items()},
            "ending": Ending(ending).name.lower(),
            "speed": float(decisions.speed[0]),
            "contact": Contact(int(decisions.contact[0])).name.lower(),
        }
        reward = float(score(self._weights, decisions.rewards)[0])
        ended = ending in _TERMINAL
        return self._seen(decisions.observation), reward, ended, ending == int(Ending.TIMEOUT), info

    def _seen(self, observation: np.ndarray) -> np.ndarray:
        if self._clock:
            return np.append(observation[0], self.batch.time[0]).astype(np.float32)
        return observation[0]

    def _place(self) -> dict[str, Any]:
        traffic, road = self.batch.traffic, self.world.road
        recording = int(traffic.recording[0])
        vehicle = int(road.recording_first[recording] + traffic.ego[0])
        described = self.world.provenance.get("recordings", [])
        name = described[recording]["recording"] if recording < len(described) else ""
        return {"recording": name, "vehicle": int(road.identity[vehicle])}

    def render(self) -> np.ndarray | None:
        """Return a picture of the current state, uint8 (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        from socialiq.worlds.pictures import pixels
        from socialiq_recordings.world.compare import scene

        return pixels(scene(self.batch))


def load_world(file: str | Path) -> RecordedWorld:
    """Read a world, once for a file that doesn't change.

    Raises:
        UserError: If no file is named, or it is no world.
    """
    if not str(file):
        raise UserError("name the world: file=W, a file of `socialiq data world`")
    path = Path(file).absolute()
    try:
        changed = path.stat().st_mtime_ns
    except OSError:
        changed = 0  # `load` says why it can't be read
    return _load(path, changed)


@lru_cache(maxsize=4)
def _load(path: Path, _changed: int) -> RecordedWorld:
    return RecordedWorld.load(path)
