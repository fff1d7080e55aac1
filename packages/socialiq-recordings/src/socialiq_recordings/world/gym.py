"""Recorded junction as a Gymnasium environment."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.worlds.highway.gym import RoadEnv
from socialiq_recordings.world.batch import JunctionBatch
from socialiq_recordings.world.recorded_world import RecordedWorld


class RecordedJunctionEnv(RoadEnv):
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
        world = load_world(file)
        if sha256 and sha256 != world.sha256:
            raise UserError(f"{file} is not the world with the SHA-256 {sha256[:12]}...")
        batch = world.batch(1)
        super().__init__(world, batch, angle, render_mode, clock)
        self.world: RecordedWorld = world
        self.batch: JunctionBatch = batch

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        observation, _ = super().reset(seed=seed, options=options)
        traffic, world = self.batch.traffic, self.world
        recording = int(traffic.recording[0])
        vehicle = int(world.road.recording_first[recording] + traffic.ego[0])
        described = world.provenance.get("recordings", [])
        name = described[recording]["recording"] if recording < len(described) else ""
        return observation, {"recording": name, "vehicle": int(world.road.identity[vehicle])}

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
    return _load(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=4)
def _load(path: Path, _changed: int) -> RecordedWorld:
    return RecordedWorld.load(path)
