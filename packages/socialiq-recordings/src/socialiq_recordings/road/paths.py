"""Polylines and arcs with coordinates along and across.

A point before a line's start or behind its end is measured along the line's straight extension, on
an arc along the circle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64

from socialiq.physics import wrapped

OfPoints = Float64[np.ndarray, " point"]
Points = Float64[np.ndarray, "point 2"]


class Coordinates(NamedTuple):
    """Coordinates of points relative to a line."""

    along: OfPoints  # distance from the line's start, m; negative before it
    lateral: OfPoints  # distance to the left of the line, m
    heading: OfPoints  # direction of the line there, rad


_MANY = 50_000  # pairs of points and segments to compare at once
_TOGETHER = 50  # points to compare at once
ROUNDING = 0.1  # m; more than errors of distances are


def on_segments(
    x: Any, y: Any, from_x: Any, from_y: Any, east: Any, north: Any, low: Any, high: Any
) -> tuple[Any, Any, Any]:
    """Return coordinates of points along segments within bounds, to their left, and distances, m.

    The segments are the first columns of `Polyline.segments`; all arguments fit each other.

    Args:
        x: Places of the points to the east, m.
        y: Places of the points to the north, m.
        from_x: Starts of the segments to the east, m.
        from_y: Starts of the segments to the north, m.
        east: Eastern components of the segments' unit vectors.
        north: Northern components of the segments' unit vectors.
        low: Lowest coordinates on the segments, m.
        high: Highest coordinates on the segments, m.
    """
    dx = x - from_x
    dy = y - from_y
    along = dx * east + dy * north
    left = dy * east - dx * north
    inside = np.minimum(np.maximum(along, low), high)
    return inside, left, np.hypot(along - inside, left)


def _nearest(x: OfPoints, y: OfPoints, segments: Float64[np.ndarray, "8 piece"]) -> Coordinates:
    *pieces, heading, starts = segments
    inside, left, distance = on_segments(x[:, None], y[:, None], *pieces)
    piece = distance.argmin(axis=1)
    at = np.arange(len(x)), piece
    return Coordinates(
        starts[piece] + inside[at], np.copysign(distance[at], left[at]), heading[piece]
    )


@dataclass(frozen=True, eq=False)
class Polyline:
    """Polyline through at least two points, with different neighbours."""

    points: Points

    @cached_property
    def steps(self) -> Float64[np.ndarray, "piece 2"]:
        """Vector from each point to the next, m."""
        return np.diff(self.points, axis=0)

    @cached_property
    def lengths(self) -> Float64[np.ndarray, " piece"]:
        """Length of each segment, m."""
        return np.hypot(*self.steps.T)

    @cached_property
    def starts(self) -> Float64[np.ndarray, " piece"]:
        """Distance along the line to the start of each segment, m."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)[:-1]])

    @property
    def length(self) -> float:
        """Length in m."""
        return float(self.lengths.sum())

    @cached_property
    def segments(self) -> Float64[np.ndarray, "8 piece"]:
        """Of each segment: start x and y, unit vector, bounds of coordinates on it, heading, start.

        The first and the last go on straight beyond the line.
        """
        unit = self.steps / self.lengths[:, None]
        low = 0 * self.lengths
        high = self.lengths.copy()
        low[0] = -np.inf
        high[-1] = np.inf
        heading = np.arctan2(unit[:, 1], unit[:, 0])
        return np.stack([*self.points[:-1].T, *unit.T, low, high, heading, self.starts])

    def coordinates(self, x: OfPoints, y: OfPoints) -> Coordinates:
        """Project points on the nearest segment; of equally near segments on the first.

        Args:
            x: Places of the points to the east, m.
            y: Places of the points to the north, m.
        """
        if x.size * len(self.lengths) <= _MANY:
            return _nearest(x, y, self.segments)
        order = np.argsort(x if np.ptp(x) > np.ptp(y) else y)
        result = np.empty((3, len(x)))
        for rows in np.array_split(order, len(x) // _TOGETHER + 1):
            near = self._near(x[rows], y[rows])
            result[:, rows] = _nearest(x[rows], y[rows], near)
        return Coordinates(*result)

    def _near(self, x: OfPoints, y: OfPoints) -> Float64[np.ndarray, "8 near"]:
        """Return the segments of which one is the nearest of each of some points."""
        low, high = (np.array([[edge(x)], [edge(y)]]) for edge in (np.min, np.max))
        ends = self.points[:-1].T, self.points[1:].T
        apart = np.maximum(low - np.maximum(*ends), np.minimum(*ends) - high)
        # No point of their box is further from the segment that begins nearest to its middle.
        middle = (low + high) / 2
        half = np.hypot(*(high - low)) / 2
        reach = np.hypot(*(middle - ends[0])).min() + half + ROUNDING
        near = np.hypot(*np.maximum(apart, 0.0)) <= reach
        near[[0, -1]] = True  # which go on beyond the line
        return self.segments[:, near]

    def points_at(self, along: OfPoints) -> tuple[Points, OfPoints]:
        """Return points on the line or its straight extensions, and directions at them, rad."""
        piece = np.clip(np.searchsorted(self.starts, along, side="right") - 1, 0, None)
        unit = self.segments[2:4, piece].T
        heading = self.segments[6, piece]
        return self.points[piece] + unit * (along - self.starts[piece])[:, None], heading


@dataclass(frozen=True)
class Arc:
    """Arc of a circle."""

    x: float  # centre, m
    y: float  # centre, m
    radius: float  # m
    phase: float  # angle at its start, rad
    sense: float  # 1 counter-clockwise, -1 clockwise
    length: float  # m

    def coordinates(self, x: OfPoints, y: OfPoints) -> Coordinates:
        """Return the coordinates of points relative to the arc, at most half a turn from its start.

        Args:
            x: Places of the points to the east, m.
            y: Places of the points to the north, m.
        """
        dx = x - self.x
        dy = y - self.y
        turned = wrapped(np.arctan2(dy, dx) - self.phase)
        lateral = self.sense * (self.radius - np.hypot(dx, dy))
        heading = wrapped(self.phase + turned + self.sense * np.pi / 2)
        return Coordinates(self.sense * turned * self.radius, lateral, heading)

    def points_at(self, along: OfPoints) -> tuple[Points, OfPoints]:
        """Return points on the circle, and directions of its tangent at them, rad."""
        turned = self.phase + self.sense * along / self.radius
        points = np.stack([np.cos(turned), np.sin(turned)], axis=1) * self.radius
        return points + np.array([self.x, self.y]), wrapped(turned + self.sense * np.pi / 2)


ARC_TOLERANCE = 1e-6  # m; points this close to a circle are an arc
_LEAST_POINTS = 8  # of an arc: three points are always on a circle
_LARGEST_RADIUS = 1000.0  # m; flatter lines are polylines


def path_of(points: Points) -> Polyline | Arc:
    """Return the line through some points: an arc if they are on a circle, else a polyline."""
    points = points[np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 0])]
    polyline = Polyline(points)
    if len(points) < _LEAST_POINTS:
        return polyline
    first = points[0]
    middle = points[len(points) // 2]
    last = points[-1]
    system = 2 * np.array([middle - first, last - first])
    if abs(np.linalg.det(system)) < ARC_TOLERANCE:
        return polyline
    sides = [middle @ middle - first @ first, last @ last - first @ first]
    centre = np.linalg.solve(system, np.array(sides))
    away = points - centre
    radius = float(np.hypot(*away[0]))
    if radius > _LARGEST_RADIUS or (abs(np.hypot(*away.T) - radius) > ARC_TOLERANCE).any():
        return polyline
    phases = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    turn = float(phases[-1] - phases[0])
    if abs(turn) > np.pi:
        return polyline
    x, y = centre.tolist()
    return Arc(x, y, radius, float(phases[0]), float(np.sign(turn)), radius * abs(turn))
