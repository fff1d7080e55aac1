"""View of a road from its tables: lanes, the ego's way, and a frame that follows the ego."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.worlds.highway import scenes as tables
from socialiq.worlds.highway import shapes
from socialiq.worlds.highway.core.geometry import LANE_WIDTH
from socialiq.worlds.highway.network import APPROACH, CONFLICT, EXIT
from socialiq.worlds.highway.render import Frame, Scene

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

    Args:
        scene: The scene.
    """

    corner: tuple[float, float] | None = None

    def __init__(self, scene: tables.Scene) -> None:
        self._road = scene.road
        self.marks: tuple[str, ...] = ("obstacle",) if len(scene.road.obstacles) else ()
        self._ways = [shapes.way(lane) for lane in scene.road.lanes]
        points = np.concatenate(self._ways)
        self._low, self._high = points.min(axis=0) - _BESIDE, points.max(axis=0) + _BESIDE
        self._size = np.clip(self._high - self._low, LOWEST, WIDEST)
        self._still = [self._middle(axis) for axis in range(2)]

    def _middle(self, axis: int) -> float | None:
        """Return where the frame stands along an axis; None if it follows the ego."""
        entry = self._road.lanes[self._road.entries[0]["lane"]]
        begin = shapes.way(entry, float(self._road.entries[0]["along"]))[:1]
        meeting = zip(self._road.lanes, self._ways, strict=True)
        met = [line for lane, line in meeting if APPROACH < lane["kind"] < EXIT]
        points = np.concatenate([begin, *met])[:, axis]
        if np.ptp(points) > self._size[axis]:
            return None
        return float(points.min() + points.max()) / 2

    def frame(self, scene: Scene, strip: bool = False) -> Frame:  # noqa: ARG002  of one size
        """Return what is visible: at most `WIDEST` metres either way."""
        ego = scene.vehicles[scene.ego]
        limits = []
        for axis, (coordinate, heading) in enumerate((("x", "along_x"), ("y", "along_y"))):
            size, middle = self._size[axis], self._still[axis]
            if middle is None:
                middle = float(ego[coordinate]) + _AHEAD * size * float(ego[heading])
                middle = min(middle, self._high[axis] - size / 2)
                middle = max(middle, self._low[axis] + size / 2)
            limits += [middle - size / 2, middle + size / 2]
        return Frame(*map(float, limits))

    def ground(self, axes: Any) -> None:
        """Draw grass, asphalt with an outline, the lines between lanes, and obstacles."""
        from matplotlib.collections import LineCollection
        from matplotlib.patches import Rectangle

        corner, size = self._low - WIDEST, self._high - self._low + 2 * WIDEST
        axes.add_artist(Rectangle(tuple(corner), *size, color=shapes.GRASS))
        for line in self._ways:
            look = {"facecolor": shapes.PAINT, "linewidth": 0.0, "zorder": 1.0}
            shapes.band(axes, line, LANE_WIDTH + _OUTLINE, **look)
        for line in self._ways:
            look = {"color": shapes.ASPHALT, "linewidth": 0.6, "zorder": 1.1}
            shapes.band(axes, line, LANE_WIDTH, **look)
        between = [
            self._beside(number)
            for number, lane in enumerate(self._road.lanes)
            if lane["number"] > 0 or lane["kind"] != CONFLICT
        ]
        dashed = {"linewidths": 1.0, "linestyles": (0, (6, 4)), "color": shapes.PAINT}
        axes.add_artist(LineCollection(between, **dashed, zorder=1.3))
        for x, y in self._road.obstacles.tolist():
            shapes.obstacle(axes, shapes.Pose(x, y, 0.0))

    def _beside(self, number: int) -> Line:
        """Return the left edge of a lane; NaN where no other lane lies beside it."""
        points = np.concatenate([line for at, line in enumerate(self._ways) if at != number])
        edge = shapes.edges(self._ways[number], LANE_WIDTH)[0]
        middle = shapes.edges(self._ways[number], 2 * LANE_WIDTH)[0]  # of a lane beside it
        apart = np.array([np.hypot(*(points - point).T).min() for point in middle])
        return np.where(apart[:, None] < 1.0, edge, np.nan)

    def way(self, axes: Any, scene: Scene) -> None:
        """Draw the ego's influence zone and the rest of its way."""
        ego, lanes = scene.vehicles[scene.ego], self._road.lanes
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
        """Return the lanes of a way up to the place of arrival, on the first exit."""
        lanes, arrival = self._road.lanes, float(self._road.sight[0]["arrival"])
        for rank, number in enumerate(numbers):
            if lanes[number]["kind"] == EXIT:
                before = [self._ways[before_it] for before_it in numbers[:rank]]
                return [*before, shapes.way(lanes[number], end=arrival)]
        return [self._ways[before_it] for before_it in numbers]


def way_of(ego: np.void, road: tables.Road) -> list[int]:
    """Return the lanes of the ego's way from its entry on, by number.

    Where it is, that is the lane it steers along; on another road that of the same number, or the
    lane that begins next to the end of the one before.

    Args:
        ego: CAR record.
        road: Tables of the scene.
    """
    lanes, target = road.lanes, int(ego["target_lane"])
    first = lanes[road.entries[0]["lane"]]
    way = [int(road.entries[0]["lane"])]
    if first["road"] == lanes[target]["road"]:
        way = [target]
    for following in _roads_after(int(first["road"]), ego, road):
        before, there = lanes[way[-1]], np.flatnonzero(lanes["road"] == following)
        if lanes[target]["road"] == following:
            way.append(target)
        elif before["lanes"] == len(there):
            way.append(int(there[before["number"]]))
        else:
            end = shapes.way(before)[-1]
            apart = [float(np.hypot(*(shapes.way(lanes[n])[0] - end))) for n in there]
            way.append(int(there[int(np.argmin(apart))]))
    return way


def _roads_after(first: int, ego: np.void, road: tables.Road) -> list[int]:
    """Return the roads of the ego's way after its first: of its route, else the first that follow.

    A way that comes back to a road ends there.
    """
    if ego["route"] >= 0:
        way = road.routes[ego["route"], ego["destination"]].tolist()
        return [successor for successor in way[way.index(first) + 1 :] if successor >= 0]
    roads: list[int] = []
    while (following := int(road.successors[(roads or [first])[-1], 0])) >= 0:
        if following in (first, *roads):
            break
        roads.append(following)
    return roads
