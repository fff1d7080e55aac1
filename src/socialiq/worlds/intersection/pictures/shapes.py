"""Shapes of the intersection's pictures: road, vehicles and their marks, in metres.

Axes must have y growing downwards, as it does in the world.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from socialiq.worlds.highway.core.geometry import LANE_WIDTH, VEHICLE_LENGTH, VEHICLE_WIDTH
from socialiq.worlds.intersection.core.ego import EXIT_DISTANCE
from socialiq.worlds.intersection.core.geometry import LANES, STRAIGHT
from socialiq.worlds.pictures import EGO, OTHER

GRASS = "#dde6d5"
ASPHALT = "#8d9194"
PAINT = "#ffffff"
INK = "#222222"
GLASS = "#1f2d3a"
HEADLIGHT = "#fff3b0"
ROUTE = "#0b2f57"
ZONE = "#9ecbf5"
RED = "#e3001b"
BURST = "#ffd400"
FAINT = "#999999"
COLORS = (GRASS, ASPHALT, PAINT, INK, GLASS, HEADLIGHT, ROUTE, RED, BURST, EGO, OTHER)

JUNCTION = float(LANES["y"][STRAIGHT])  # half its width, m
_CORNER = JUNCTION - LANE_WIDTH  # radius of its kerbs, m

ZONE_APPROACH = 20.0  # m of the ego's approach that belong to its influence zone


class Pose(NamedTuple):
    """Pose of an object: centre in m, heading in rad, clockwise from east."""

    x: float
    y: float
    heading: float

    def place(self, points: Sequence[tuple[float, float]]) -> np.ndarray:
        """Convert points (metres ahead, metres to the right) to (x, y), shape (points, 2)."""
        ahead, right = np.array(points, np.float64).T
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return np.stack(
            [self.x + cos * ahead - sin * right, self.y + sin * ahead + cos * right], axis=-1
        )


def way(lane: int, start: float = 0.0, end: float = math.inf) -> np.ndarray:
    """Return the centre line of a lane.

    Args:
        lane: Its number.
        start: Lane coordinate of the first point, m.
        end: Lane coordinate of the last point, m, at most the lane's length.

    Returns:
        Points (x, y) at most half a metre apart, shape (points, 2).
    """
    record = LANES[lane]
    end = min(end, float(record["length"]))
    along = np.linspace(start, end, 2 + int(2 * (end - start)))
    if record["straight"]:
        x = record["x"] + along * record["along_x"]
        y = record["y"] + along * record["along_y"]
    else:
        angle = record["phase"] + record["sense"] * along / record["radius"]
        x = record["x"] + record["radius"] * np.cos(angle)
        y = record["y"] + record["radius"] * np.sin(angle)
    return np.stack([x, y], axis=-1)


def road(axes: Any, reach: float) -> None:
    """Draw the empty crossing: asphalt, centre lines, stop lines and give-way marks.

    Args:
        axes: Matplotlib axes.
        reach: Metres from the centre to the end of the road.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.patches import Polygon, Rectangle

    axes.add_artist(Rectangle((-reach, -reach), 2 * reach, 2 * reach, color=GRASS))
    kerb = np.concatenate([_kerb(math.pi / 2 * corner, reach) for corner in range(4)])
    axes.add_artist(
        Polygon(kerb, facecolor=ASPHALT, edgecolor=PAINT, linewidth=1.2, joinstyle="round")
    )
    arms = [Pose(0.0, 0.0, math.pi / 2 * arm + math.pi / 2) for arm in range(4)]
    centre = [arm.place([(JUNCTION, 0.0), (reach, 0.0)]) for arm in arms]
    dashed = LineCollection(centre, linewidths=1.2, linestyles=(0, (6, 4)))
    stop = [arm.place([(JUNCTION, 0.0), (JUNCTION, -LANE_WIDTH)]) for arm in arms]
    teeth = [tooth for arm in arms[::2] for tooth in _teeth(arm)]
    for marking in (dashed, LineCollection(stop, linewidths=[2.0, 1.0]), PolyCollection(teeth)):
        marking.set(color=PAINT, zorder=2)
        axes.add_artist(marking)


def _kerb(angle: float, reach: float) -> np.ndarray:
    """Return one quarter of the kerb: in along an arm, round the corner, out along the next."""
    bend = np.linspace(math.pi, 1.5 * math.pi, 12)
    x = [LANE_WIDTH, *(JUNCTION + _CORNER * np.cos(bend)), reach]
    y = [reach, *(JUNCTION + _CORNER * np.sin(bend)), LANE_WIDTH]
    return Pose(0.0, 0.0, angle).place(list(zip(x, y, strict=True)))[::-1]


def _teeth(arm: Pose) -> list[np.ndarray]:
    """Return triangles before the stop line that point at the drivers who must give way."""
    base, tip, width = JUNCTION + 0.6, JUNCTION + 2.0, LANE_WIDTH / 4
    lefts = [-width * number for number in range(4)]
    return [
        arm.place([(base, left - 0.1), (base, left - width + 0.1), (tip, left - width / 2)])
        for left in lefts
    ]


def zone(axes: Any, route: Sequence[int]) -> None:
    """Tint the ego's influence zone: the end of its approach, and its way across."""
    approach, across, _ = route
    start = float(LANES["length"][approach]) - ZONE_APPROACH
    line = np.concatenate([way(approach, start), way(across)])
    _band(axes, line)


def swatch(axes: Any, x: float, y: float) -> None:
    """Draw a sample of the influence zone's tint around (x, y), on asphalt."""
    line = np.array([[x - 2.5, y], [x + 2.5, y]])
    _band(axes, line, width=3.0, facecolor=ASPHALT, zorder=1)
    _band(axes, line, width=3.0)


def _band(axes: Any, line: np.ndarray, width: float = LANE_WIDTH, **look: Any) -> None:
    """Draw a strip along a line, by default with the influence zone's tint."""
    from matplotlib.patches import Polygon

    look = look or {"facecolor": ZONE, "alpha": 0.55, "zorder": 1.5}
    along = np.gradient(line, axis=0)
    along /= np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    across = width / 2 * np.stack([-along[:, 1], along[:, 0]], axis=-1)
    axes.add_artist(Polygon(np.concatenate([line + across, (line - across)[::-1]]), **look))


def route(axes: Any, lanes: Sequence[int], x: float, y: float) -> None:
    """Dot the rest of a route from the closest point to (x, y), with an arrow at its end."""
    approach, across, leave = lanes
    line = np.concatenate([way(approach), way(across), way(leave, end=EXIT_DISTANCE)])
    left = line[int(np.argmin(np.hypot(line[:, 0] - x, line[:, 1] - y))) :]
    dots(axes, left)
    ahead = line[-1] - line[-2]
    tip = Pose(float(line[-1, 0]), float(line[-1, 1]), math.atan2(ahead[1], ahead[0]))
    _fill(axes, tip, [(1.8, 0.0), (-0.4, -1.3), (-0.4, 1.3)], facecolor=ROUTE, zorder=3)


def dots(axes: Any, line: np.ndarray) -> None:
    """Draw a dotted line through points (x, y), shape (points, 2)."""
    from matplotlib.lines import Line2D

    dotted = (0, (1, 1.4))
    axes.add_artist(Line2D(*line.T, color=ROUTE, linewidth=1.8, linestyle=dotted, zorder=3))


def _fill(axes: Any, pose: Pose, points: Sequence[tuple[float, float]], **look: Any) -> None:
    from matplotlib.patches import Polygon

    axes.add_artist(Polygon(pose.place(points), **look))


def _mirrored(half: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return an outline from its right half, given from front to back."""
    return [*half, *((ahead, -right) for ahead, right in reversed(half))]


_NOSE, _SIDE = VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2
_BODY = _mirrored(
    [
        (_NOSE, 0.35),
        (_NOSE - 0.3, _SIDE - 0.2),
        (_NOSE - 0.8, _SIDE),
        (0.25 - _NOSE, _SIDE),
        (-_NOSE, _SIDE - 0.25),
    ]
)
_WINDSCREEN = _mirrored([(1.5, 0.85), (0.3, 0.65)])
_REAR_WINDOW = _mirrored([(-1.6, 0.6), (-2.0, 0.7)])
_LAMP = [(_NOSE - 0.5, 0.35), (_NOSE + 0.15, 0.35), (_NOSE - 0.1, 0.95), (_NOSE - 0.8, 0.95)]


def vehicle(axes: Any, pose: Pose, color: str) -> None:
    """Draw a car with a windscreen and headlights that show its heading."""
    _fill(axes, pose, _BODY, facecolor=color, edgecolor=PAINT, linewidth=0.8, zorder=6)
    for glass in (_WINDSCREEN, _REAR_WINDOW):
        _fill(axes, pose, glass, facecolor=GLASS, zorder=7)
    for side in (-1, 1):
        lamp = [(ahead, side * right) for ahead, right in _LAMP]
        _fill(axes, pose, lamp, facecolor=HEADLIGHT, zorder=7)


def brake_lights(axes: Any, pose: Pose) -> None:
    """Draw two red lights at a car's rear, with their glow."""
    from matplotlib.patches import Circle

    for centre in pose.place([(-_NOSE, -0.75), (-_NOSE, 0.75)]):
        axes.add_artist(Circle(centre, 1.5, facecolor=RED, alpha=0.3, zorder=5))
        axes.add_artist(Circle(centre, 0.7, facecolor=RED, edgecolor=PAINT, lw=0.5, zorder=8))


def burst(axes: Any, pose: Pose, size: float = 1.0) -> None:
    """Draw the star of a collision, behind a car."""
    angles = np.linspace(0, 2 * math.pi, 25)
    radii = size * np.where(np.arange(25) % 2, 3.0, 4.6)
    star = list(zip(radii * np.cos(angles), radii * np.sin(angles), strict=True))
    _fill(axes, pose, star, facecolor=BURST, edgecolor=RED, linewidth=1.2, zorder=4)


def give_way(axes: Any, x: float, y: float) -> None:
    """Draw the road sign "give way", point down, centred at (x, y)."""
    for size, color in ((2.0, RED), (1.1, PAINT)):
        sign = [(-size / 2, -0.87 * size), (-size / 2, 0.87 * size), (size, 0.0)]
        upside = Pose(x, y, math.pi / 2)
        _fill(axes, upside, sign, facecolor=color, edgecolor=PAINT, linewidth=0.5, zorder=8)


def beside(pose: Pose, ahead: float, gap: float, half: tuple[float, float]) -> tuple[float, float]:
    """Return the centre of a box to the right of a car, at the same distance for any heading.

    Args:
        pose: Pose of the car.
        ahead: Metres by which the centre lies ahead of the car's.
        gap: Metres between the car's side and the box.
        half: Half the box's extent along x and along y, m.
    """
    side = abs(math.sin(pose.heading)) * half[0] + abs(math.cos(pose.heading)) * half[1]
    x, y = pose.place([(ahead, _SIDE + gap + side)])[0]
    return float(x), float(y)
