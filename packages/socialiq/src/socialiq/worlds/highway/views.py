"""View of a road from its tables: lanes, the ego's way, and a frame that follows the ego."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.worlds.highway import scenes as tables
from socialiq.worlds.highway import shapes
from socialiq.worlds.highway.core.traffic import AGENT_AT
from socialiq.worlds.highway.network import APPROACH, CONFLICT, EXIT, LANE_WIDTH
from socialiq.worlds.highway.render import Frame, Scene
from socialiq.worlds.highway.ways import arrival_lane, way_of

WIDEST = 130.0  # m of the road in a picture
LOWEST = 30.0  # m
_BESIDE = 10.0  # m of grass beside the road
_AHEAD = 0.2  # of the frame, by which it lies ahead of an ego that it follows
_OUTLINE = 0.7  # m of paint around the asphalt

Line = Float[np.ndarray, "point 2"]


class Lanes:
    """A scene's road as a view, from its lanes alone.

    The frame stands still in a direction in which the place where ways meet and the ego's entry fit
    into it; else it follows the ego.
    """

    corner: tuple[float, float] | None = None

    def __init__(self, scene: tables.Scene, walks: bool = False, rides: bool = False) -> None:
        self._road = scene.road
        self._walks = walks
        self._rides = rides
        self._is_crossing = scene.edge > 0
        marks = {"gives way": len(scene.road.arrivals), "obstacle": len(scene.road.obstacles)}
        self.marks = tuple(mark for mark, count in marks.items() if count)
        self._ways = [shapes.way(lane) for lane in scene.road.lanes]
        points = np.concatenate(self._ways)
        self._low = points.min(axis=0) - _BESIDE
        self._high = points.max(axis=0) + _BESIDE
        self._size = np.clip(self._high - self._low, LOWEST, WIDEST)
        road = scene.road
        number = road.arrivals[0, 0] if len(road.arrivals) else road.entries[0]["lane"]
        along = AGENT_AT if len(road.arrivals) else float(road.entries[0]["along"])
        begin = shapes.way(road.lanes[int(number)], along)[:1]
        meeting = zip(road.lanes, self._ways, strict=True)
        met = [line for lane, line in meeting if APPROACH < lane["kind"] < EXIT]
        points = np.concatenate([begin, *met])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        fits = np.ptp(points, axis=0) <= self._size
        self._still = [float(at) if fit else None for at, fit in zip(middle, fits, strict=True)]

    def frame(self, scene: Scene, strip: bool = False) -> Frame:  # noqa: ARG002  of one size
        """Return the visible part of the world: at most `WIDEST` metres either way.

        Args:
            scene: Scene with the ego, which the frame may follow.
            strip: Not used: frames of a filmstrip have the same size.
        """
        ego = scene.vehicles[scene.ego]
        limits = []
        for axis, (coordinate, heading) in enumerate((("x", "along_x"), ("y", "along_y"))):
            size = self._size[axis]
            middle = self._still[axis]
            if middle is None:
                middle = float(ego[coordinate]) + _AHEAD * size * float(ego[heading])
                middle = min(middle, self._high[axis] - size / 2)
                middle = max(middle, self._low[axis] + size / 2)
            limits += [middle - size / 2, middle + size / 2]
        return Frame(*map(float, limits))

    def ground(self, axes: Any) -> None:
        """Draw grass, asphalt with an outline, the lines between lanes, and obstacles."""
        from matplotlib.collections import LineCollection
        from matplotlib.patches import Polygon, Rectangle

        corner = self._low - WIDEST
        size = self._high - self._low + 2 * WIDEST
        axes.add_artist(Rectangle(tuple(corner), *size, color=shapes.GRASS))
        for line in self._ways:
            look = {"facecolor": shapes.PAINT, "linewidth": 0.0, "zorder": 1.0}
            shapes.band(axes, line, LANE_WIDTH + _OUTLINE, **look)
        for line in self._ways:
            look = {"color": shapes.ASPHALT, "linewidth": 0.6, "zorder": 1.1}
            shapes.band(axes, line, LANE_WIDTH, **look)
        for lane, line in zip(self._road.lanes, self._ways, strict=True):
            if self._is_crossing and APPROACH < lane["kind"] < EXIT:
                across = np.concatenate([line, [(0.0, 0.0)]])  # the middle is paved too
                axes.add_artist(Polygon(across, color=shapes.ASPHALT, zorder=1.1))
        between = [
            self._beside(number)
            for number, lane in enumerate(self._road.lanes)
            if lane["number"] > 0 or lane["kind"] != CONFLICT
        ]
        dashed = {"linewidths": 1.0, "linestyles": (0, (6, 4)), "color": shapes.PAINT}
        axes.add_artist(LineCollection(between, **dashed, zorder=1.3))
        if self._walks:
            shapes.ways_of_people(axes, self._road.crossings.ways, self._rides)
        for x, y in self._road.obstacles.tolist():
            shapes.obstacle(axes, shapes.Pose(x, y, 0.0))

    def _beside(self, number: int) -> Line:
        """Return the left edge of a lane; NaN where no lane adjoins it."""
        points = np.concatenate([line for at, line in enumerate(self._ways) if at != number])
        edge = shapes.edges(self._ways[number], LANE_WIDTH)[0]
        middle = shapes.edges(self._ways[number], 2 * LANE_WIDTH)[0]  # of a lane beside it
        apart = np.array([np.hypot(*(points - point).T).min() for point in middle])
        return np.where(apart[:, None] < 1.0, edge, np.nan)

    def way(self, axes: Any, scene: Scene) -> None:
        """Draw the ego's influence zone and the rest of its way.

        Args:
            axes: Axes to draw in.
            scene: Scene with the ego.
        """
        ego = scene.vehicles[scene.ego]
        lanes = self._road.lanes
        numbers = way_of(ego, self._road)
        for number, following in zip(numbers, [*numbers[1:], -1], strict=True):
            meets = following >= 0 and lanes[following]["kind"] != APPROACH
            if lanes[number]["kind"] == APPROACH and meets:
                start = max(0.0, float(lanes[number]["length"]) - shapes.ZONE_APPROACH)
                shapes.band(axes, shapes.way(lanes[number], start))
            elif lanes[number]["kind"] not in (APPROACH, EXIT):
                shapes.band(axes, self._ways[number])
        line = np.concatenate(self._to_arrival(numbers))
        shapes.route(axes, line, float(ego["x"]), float(ego["y"]))

    def _to_arrival(self, numbers: list[int]) -> list[Line]:
        """Return the lanes of a way up to the place of arrival."""
        ways = [self._ways[number] for number in numbers]
        last = arrival_lane(numbers, self._road)
        if last is None:
            return ways
        arrival = float(self._road.sight[0]["arrival"])
        return [*ways[:last], shapes.way(self._road.lanes[numbers[last]], end=arrival)]
