"""A recorded junction as a Gymnasium environment, and its picture."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from socialiq.errors import UserError
from socialiq.physics import corners
from socialiq.worlds.gym import RoadEnv
from socialiq.worlds.highway.options import Schema
from socialiq_recordings.world.batch import PERSON, JunctionBatch
from socialiq_recordings.world.config import SUB_STEPS
from socialiq_recordings.world.recorded_world import RecordedWorld

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class RecordedJunctionEnv(RoadEnv):
    """Recorded junction with the Gymnasium interface.

    The ego takes the place of a recorded vehicle at a recorded moment, both drawn by the seed, and
    drives its way. The others are drivers of the calibrated population; they start as recorded,
    enter where and when the recorded ones did, and react. The scalar reward is R(α) (Eq 4.3).

    `info` has `reward_pair` (r_env, r_social), `signals` (every named signal, unweighted), `ending`
    (arrival, collision, timeout, or other: over a closed line), the ego's `speed` in m/s, `contact`
    (which vehicle struck), `neighbours_collided` (number of others that drove into each other), and
    in that of `reset` the `recording` and `vehicle` of its place. Where people were recorded, the
    signals have `pedestrian_hit` and `bicycle_hit` (whether one touches the ego), and `others_hit`.

    Args:
        file: World of `socialiq data world`.
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: "rgb_array" or None.
        clock: Whether observations end with the time, in decisions since the reset.
        sha256: Of the world's content, if it must be a certain one.
        shift: Faults of sensors and of actions, as for `RoadWorld.shifted`.
        front_end: Perception before the policy, as for `RoadWorld.shifted`.
        observation: Schema of observations: rows, or route, whose actions are `ROUTE_ACTIONS`.

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
        shift: str = "",
        front_end: str = "",
        observation: Schema = "rows",
    ) -> None:
        world = load_world(file).showing(observation)
        if sha256 and sha256 != world.sha256:
            raise UserError(f"{file} is not the world with the SHA-256 {sha256[:12]}...")
        super().__init__(world.shifted(shift, front_end), angle, render_mode, clock)
        self.world: RecordedWorld
        self.batch: JunctionBatch

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Seed of the episode; None goes on with the stream of the last seed.
            options: Options of Gymnasium's interface, which are not used.

        Returns:
            The observation, and the `recording` and the number of the `vehicle` whose place the ego
            takes.
        """
        observation, _ = super().reset(seed=seed, options=options)
        world = self.world
        recording = self.batch.recording()
        vehicle = int(world.road.recording_first[recording] + self.batch.egos[0])
        described = world.provenance.get("recordings", [])
        name = described[recording]["recording"] if recording < len(described) else ""
        return observation, {"recording": name, "vehicle": int(world.road.identity[vehicle])}

    def render(self) -> np.ndarray | None:
        """Return a picture of the current state, uint8 (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        from socialiq.worlds.pictures import pixels

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


_REACH = 50.0  # m around the ego
_BAR = 1.6  # m to either side of a closed line


def scene(batch: JunctionBatch, row: int = 0) -> Figure:
    """Draw a moment of an episode: all ways, the ego's way, vehicles, closed lines.

    Args:
        batch: Episodes of the world.
        row: Episode that is drawn.

    Returns:
        A picture of 50 m around the ego in each direction.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Polygon

    from socialiq.plotting.style import COLORS, figure, finish
    from socialiq.worlds.pictures import EGO, OTHER
    from socialiq_recordings.world.geometry import place_of  # imports Numba

    road = batch.world.road
    drawing = figure(5.0, 5.0)
    axes = drawing.subplots()
    lines = batch.ways(row)
    axes.add_collection(LineCollection(lines, colors="#d5d5d5", linewidths=1.0))
    ego = batch.buffers.vehicles[row, batch.egos[row]]
    axes.plot(*lines[ego["identity"]].T, color=EGO, linewidth=1.2)
    now = float(batch.buffers.episodes["sub_steps"][row]) / SUB_STEPS
    for way in batch.on_road(row)["way"]:
        for at, begin, until in road.closed[road.closed_first[way] : road.closed_first[way + 1]]:
            if begin <= now < until:
                x, y, heading = place_of(road, way, at)
                dx = -_BAR * math.sin(heading)
                dy = _BAR * math.cos(heading)
                ends = [x - dx, x + dx], [y - dy, y + dy]
                axes.plot(*ends, color="black", linewidth=2.0, zorder=4)
    for number, (x, y, heading, _, *size) in batch.places(row):
        ink = EGO if number < 0 else OTHER if number < PERSON else COLORS["altruistic"]
        axes.add_patch(Polygon(corners((x, y), heading, *size), color=ink, zorder=3))
    x = float(ego["x"])
    y = float(ego["y"])
    axes.set_aspect("equal")
    axes.set(xlim=(x - _REACH, x + _REACH), ylim=(y - _REACH, y + _REACH))
    finish(axes, f"{now:.1f} s", xlabel="m to the east", ylabel="m to the north")
    return drawing
