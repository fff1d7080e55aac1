"""Shapes of the pictures of roads: lanes, vehicles and their marks, in metres.

Axes must have y growing downwards, as it does in the world.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH
from socialiq.worlds.highway.crossings import HALF_WIDTH, PAVEMENT
from socialiq.worlds.highway.network import LANE_WIDTH
from socialiq.worlds.pictures import EGO, OTHER
from socialiq.worlds.road_users import ON_FOOT, RIDES

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
PERSON = "#6b1f8f"
BICYCLES = "#b9816b"
COLORS = (
    GRASS, ASPHALT, PAINT, INK, GLASS, HEADLIGHT, ROUTE, RED, BURST, PERSON, BICYCLES, EGO, OTHER,
)  # fmt: skip

_FAR = 100.0  # m of a bicycle lane either way
_BICYCLE_LANE = 1.5  # m, its width
ZONE_APPROACH = 20.0  # m of the ego's approach that belong to its influence zone


class Pose(NamedTuple):
    """Pose of an object: centre in m, heading in rad, clockwise from east."""

    x: float
    y: float
    heading: float

    def to_world(self, points: Sequence[tuple[float, float]]) -> np.ndarray:
        """Convert points (metres ahead, metres to the right) to (x, y), shape (points, 2)."""
        ahead, right = np.array(points, np.float64).T
        cos = math.cos(self.heading)
        sin = math.sin(self.heading)
        return np.stack(
            [self.x + cos * ahead - sin * right, self.y + sin * ahead + cos * right], axis=-1
        )


def way(lane: Any, start: float = 0.0, end: float = math.inf) -> np.ndarray:
    """Return the centre line of a lane.

    Args:
        lane: Record of the lane.
        start: Coordinate along the lane at which the line begins, m.
        end: Coordinate at which it ends, m; at most the lane's length counts.

    Returns:
        Points (x, y), m, (points, 2): at most half a metre apart, except on a sine.
    """
    end = min(end, float(lane["length"]))
    along = np.linspace(start, end, 2 + int(2 * (end - start)))
    if lane["straight"]:
        aside = lane["amplitude"] * np.sin(lane["pulsation"] * along + lane["shift"])
        x = lane["x"] + along * lane["along_x"] + aside * lane["across_x"]
        y = lane["y"] + along * lane["along_y"] + aside * lane["across_y"]
    else:
        angle = lane["phase"] + lane["sense"] * along / lane["radius"]
        x = lane["x"] + lane["radius"] * np.cos(angle)
        y = lane["y"] + lane["radius"] * np.sin(angle)
    return np.stack([x, y], axis=-1)


def edges(line: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the left and the right edge of a strip along a line.

    Args:
        line: Points (x, y) of the middle, (points, 2), m.
        width: Width of the strip, m.

    Returns:
        Points of both edges, each in the shape of the line.
    """
    along = np.gradient(line, axis=0)
    along /= np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    across = width / 2 * np.stack([-along[:, 1], along[:, 0]], axis=-1)
    return line - across, line + across


def band(axes: Any, line: np.ndarray, width: float = LANE_WIDTH, **look: Any) -> None:
    """Draw a strip along a line.

    Args:
        axes: Axes to draw in.
        line: Points (x, y) of the middle, (points, 2), m.
        width: Width of the strip, m.
        **look: Look of matplotlib's polygon; by default the influence zone's tint.
    """
    from matplotlib.patches import Polygon

    look = look or {"facecolor": ZONE, "alpha": 0.55, "zorder": 1.5}
    left, right = edges(line, width)
    axes.add_artist(Polygon(np.concatenate([right, left[::-1]]), **look))


def route(axes: Any, line: np.ndarray, x: float, y: float) -> None:
    """Dot a way from its closest point to a place on, with an arrow at its end.

    Args:
        axes: Axes to draw in.
        line: Points (x, y) of the way, (points, 2), m.
        x: x of the place, m.
        y: y of the place, m.
    """
    left = line[int(np.argmin(np.hypot(line[:, 0] - x, line[:, 1] - y))) :]
    dots(axes, left)
    ahead = line[-1] - line[-2]
    tip = Pose(float(line[-1, 0]), float(line[-1, 1]), math.atan2(ahead[1], ahead[0]))
    fill(axes, tip, [(1.8, 0.0), (-0.4, -1.3), (-0.4, 1.3)], facecolor=ROUTE, zorder=3)


def dots(axes: Any, line: np.ndarray) -> None:
    """Draw a dotted line.

    Args:
        axes: Axes to draw in.
        line: Points (x, y), (points, 2), m.
    """
    from matplotlib.lines import Line2D

    dotted = (0, (1, 1.4))
    axes.add_artist(Line2D(*line.T, color=ROUTE, linewidth=1.8, linestyle=dotted, zorder=3))


def fill(axes: Any, pose: Pose, points: Sequence[tuple[float, float]], **look: Any) -> None:
    """Draw a polygon.

    Args:
        axes: Axes to draw in.
        pose: Pose in whose frame the points are.
        points: Corners (metres ahead, metres to the right).
        **look: Look of matplotlib's polygon.
    """
    from matplotlib.patches import Polygon

    axes.add_artist(Polygon(pose.to_world(points), **look))


def _mirrored(half: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return an outline from its right half, given from front to back."""
    return [*half, *((ahead, -right) for ahead, right in reversed(half))]


_NOSE = VEHICLE_LENGTH / 2
_SIDE = VEHICLE_WIDTH / 2
_BONNET = [(_NOSE, 0.35), (_NOSE - 0.3, _SIDE - 0.2), (_NOSE - 0.8, _SIDE)]
_BODY = _mirrored([*_BONNET, (0.25 - _NOSE, _SIDE), (-_NOSE, _SIDE - 0.25)])
_WINDSCREEN = _mirrored([(1.5, 0.85), (0.3, 0.65)])
_REAR_WINDOW = _mirrored([(-1.6, 0.6), (-2.0, 0.7)])
_LAMP = [(_NOSE - 0.5, 0.35), (_NOSE + 0.15, 0.35), (_NOSE - 0.1, 0.95), (_NOSE - 0.8, 0.95)]


def vehicle(axes: Any, pose: Pose, color: str) -> None:
    """Draw a car with a windscreen and headlights that show its heading.

    Args:
        axes: Axes to draw in.
        pose: Pose of the car.
        color: Colour of its body.
    """
    fill(axes, pose, _BODY, facecolor=color, edgecolor=PAINT, linewidth=0.8, zorder=6)
    for glass in (_WINDSCREEN, _REAR_WINDOW):
        fill(axes, pose, glass, facecolor=GLASS, zorder=7)
    for side in (-1, 1):
        lamp = [(ahead, side * right) for ahead, right in _LAMP]
        fill(axes, pose, lamp, facecolor=HEADLIGHT, zorder=7)


def person(axes: Any, pose: Pose, length: float, width: float) -> None:
    """Draw a person larger than life: a circle, and on a vehicle that is longer than wide a bar.

    Args:
        axes: Axes to draw in.
        pose: Pose of the person.
        length: Length of the person with the vehicle, m.
        width: Width, m.
    """
    from matplotlib.patches import Circle

    look = {"facecolor": PERSON, "edgecolor": PAINT, "linewidth": 0.6, "zorder": 6}
    if length > width:
        half = length * 1.1 / 1.8
        fill(axes, pose, [(half, -0.25), (half, 0.25), (-half, 0.25), (-half, -0.25)], **look)
    axes.add_artist(Circle((pose.x, pose.y), 0.6, **look))


def stripes(axes: Any, middle: Pose, half_width: float, reach: float) -> None:
    """Draw a crosswalk.

    Args:
        axes: Axes to draw in.
        middle: Middle of the crosswalk, with the heading of the road that it crosses.
        half_width: Half the length of a stripe, m.
        reach: Half the width of the road, m.
    """
    for left in np.arange(0.3 - reach, reach, 1.0):
        ends = [(-half_width, left), (half_width, left)]
        corners = [*ends, *((along, left + 0.5) for along, _ in reversed(ends))]
        fill(axes, middle, corners, facecolor=PAINT, zorder=2)


def ways_of_people(axes: Any, ways: np.ndarray, rides: bool) -> None:
    """Draw crosswalks, and bicycle lanes if people ride.

    Args:
        axes: Axes to draw in.
        ways: WAY records of the road (`crossings.WAY`).
        rides: Whether bicycle lanes are drawn.
    """
    on_foot = ways[ways["motion"] == ON_FOOT]
    for way_there in on_foot[1::2]:  # each crosswalk has two ways
        x, y, heading, half = (float(way_there[name]) for name in ("x", "y", "heading", "half"))
        stripes(axes, Pose(x, y, heading + math.pi / 2), HALF_WIDTH, half - PAVEMENT)
    for ride in ways[ways["motion"] == RIDES] if rides else ():
        pose = Pose(float(ride["x"]), float(ride["y"]), float(ride["heading"]))
        lane = pose.to_world([(-_FAR, 0.0), (_FAR, 0.0)])
        look = {"facecolor": BICYCLES, "alpha": 0.5, "zorder": 1.2}
        band(axes, lane, _BICYCLE_LANE, **look)


def brake_lights(axes: Any, pose: Pose) -> None:
    """Draw two red lights at a car's rear, with their glow.

    Args:
        axes: Axes to draw in.
        pose: Pose of the car.
    """
    from matplotlib.patches import Circle

    for centre in pose.to_world([(-_NOSE, -0.75), (-_NOSE, 0.75)]):
        axes.add_artist(Circle(centre, 1.5, facecolor=RED, alpha=0.3, zorder=5))
        axes.add_artist(Circle(centre, 0.7, facecolor=RED, edgecolor=PAINT, lw=0.5, zorder=8))


def burst(axes: Any, pose: Pose, size: float = 1.0) -> None:
    """Draw the star of a collision, behind a car.

    Args:
        axes: Axes to draw in.
        pose: Pose of the car.
        size: Factor of the star's size; 1 gives a radius of 4.6 m.
    """
    angles = np.linspace(0, 2 * math.pi, 25)
    radii = size * np.where(np.arange(25) % 2, 3.0, 4.6)
    star = list(zip(radii * np.cos(angles), radii * np.sin(angles), strict=True))
    fill(axes, pose, star, facecolor=BURST, edgecolor=RED, linewidth=1.2, zorder=4)


def obstacle(axes: Any, pose: Pose) -> None:
    """Draw an obstacle, a square of 2 m with a cross.

    Args:
        axes: Axes to draw in.
        pose: Pose of the obstacle.
    """
    square = [(-_SIDE, -_SIDE), (-_SIDE, _SIDE), (_SIDE, _SIDE), (_SIDE, -_SIDE)]
    fill(axes, pose, square, facecolor=RED, edgecolor=PAINT, linewidth=0.8, zorder=6)
    for side in (-1, 1):
        bar = [(-0.8, -0.5 * side), (-0.5, -0.8 * side), (0.8, 0.5 * side), (0.5, 0.8 * side)]
        fill(axes, pose, bar, facecolor=PAINT, zorder=7)


def give_way(axes: Any, x: float, y: float) -> None:
    """Draw the road sign "give way", point down.

    Args:
        axes: Axes to draw in.
        x: x of the sign's centre, m.
        y: y of the sign's centre, m.
    """
    for size, color in ((2.0, RED), (1.1, PAINT)):
        sign = [(-size / 2, -0.87 * size), (-size / 2, 0.87 * size), (size, 0.0)]
        upside = Pose(x, y, math.pi / 2)
        fill(axes, upside, sign, facecolor=color, edgecolor=PAINT, linewidth=0.5, zorder=8)


def beside(pose: Pose, ahead: float, gap: float, half: tuple[float, float]) -> tuple[float, float]:
    """Return the centre of a box to the right of a car, at the same distance for any heading.

    Args:
        pose: Pose of the car.
        ahead: Distance of the box ahead of the car's centre, m.
        gap: Distance from the car's side to the box, m.
        half: Half the extent of the box along x and along y, m.

    Returns:
        The centre (x, y), m.
    """
    side = abs(math.sin(pose.heading)) * half[0] + abs(math.cos(pose.heading)) * half[1]
    x, y = pose.to_world([(ahead, _SIDE + gap + side)])[0]
    return float(x), float(y)
