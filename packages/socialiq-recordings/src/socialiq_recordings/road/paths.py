"""Paths with longitudinal and lateral coordinates.

A point before a line's start or behind its end is measured along the line's straight extension,
on an arc along the circle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

ARC_TOLERANCE = 1e-6  # m; points this close to a circle are an arc
_LEAST_POINTS = 8  # of an arc: three points are always on a circle
_LARGEST_RADIUS = 1000.0  # m; flatter lines are polylines


class Coordinates(NamedTuple):
    """Coordinates of points relative to a line.

    Attributes:
        along: Distance along the line from its start, m; negative before it.
        lateral: Distance to the left of the line, m.
        heading: Direction of the line there, rad.
    """

    along: Float64[np.ndarray, " point"]
    lateral: Float64[np.ndarray, " point"]
    heading: Float64[np.ndarray, " point"]


@dataclass(frozen=True, eq=False)
class Polyline:
    """Polyline.

    Attributes:
        points: At least two points, with different neighbours.
    """

    points: Float64[np.ndarray, "point 2"]

    @cached_property
    def steps(self) -> Float64[np.ndarray, "piece 2"]:
        """Vector from each point to the next, m."""
        return np.diff(self.points, axis=0)

    @cached_property
    def _lengths(self) -> Float64[np.ndarray, " piece"]:
        return np.hypot(*self.steps.T)

    @cached_property
    def starts(self) -> Float64[np.ndarray, " piece"]:
        """Distance along the line to the start of each segment, m."""
        return np.concatenate([[0.0], np.cumsum(self._lengths)[:-1]])

    @property
    def length(self) -> float:
        """Length in m."""
        return float(self._lengths.sum())

    def coordinates(
        self, x: Float64[np.ndarray, " point"], y: Float64[np.ndarray, " point"]
    ) -> Coordinates:
        """Project points on the nearest segment; of equally near segments on the first."""
        steps, starts, lengths = self.steps, self.starts, self._lengths
        unit = steps / lengths[:, None]
        dx, dy = x[:, None] - self.points[:-1, 0], y[:, None] - self.points[:-1, 1]
        along = dx * unit[:, 0] + dy * unit[:, 1]
        left = dy * unit[:, 0] - dx * unit[:, 1]
        low, high = np.zeros(len(steps)), lengths.copy()
        low[0], high[-1] = -np.inf, np.inf
        outside = along - np.clip(along, low, high)
        piece = np.argmin(np.hypot(outside, left), axis=1)
        rows = np.arange(len(x))
        beside = np.copysign(np.hypot(outside, left), left)[rows, piece]
        inside = np.clip(along, low, high)[rows, piece]
        heading = np.arctan2(unit[:, 1], unit[:, 0])[piece]
        return Coordinates(starts[piece] + inside, beside, heading)

    def points_at(
        self, along: Float64[np.ndarray, " point"]
    ) -> tuple[Float64[np.ndarray, "point 2"], Float64[np.ndarray, " point"]]:
        """Return points on the line or its straight extensions, and directions there, rad."""
        piece = np.clip(np.searchsorted(self.starts, along, side="right") - 1, 0, None)
        unit = self.steps / self._lengths[:, None]
        points = self.points[piece] + unit[piece] * (along - self.starts[piece])[:, None]
        return points, np.arctan2(unit[piece, 1], unit[piece, 0])


@dataclass(frozen=True)
class Arc:
    """Arc of a circle.

    Attributes:
        x: Centre, m.
        y: Centre, m.
        radius: m.
        phase: Angle at its start, rad.
        sense: 1 counter-clockwise, -1 clockwise.
        length: m.
    """

    x: float
    y: float
    radius: float
    phase: float
    sense: float
    length: float

    def coordinates(
        self, x: Float64[np.ndarray, " point"], y: Float64[np.ndarray, " point"]
    ) -> Coordinates:
        """Return polar coordinates, with angles at most half a turn from the start."""
        dx, dy = x - self.x, y - self.y
        turned = wrapped(np.arctan2(dy, dx) - self.phase)
        lateral = self.sense * (self.radius - np.hypot(dx, dy))
        heading = wrapped(self.phase + turned + self.sense * np.pi / 2)
        return Coordinates(self.sense * turned * self.radius, lateral, heading)

    def points_at(
        self, along: Float64[np.ndarray, " point"]
    ) -> tuple[Float64[np.ndarray, "point 2"], Float64[np.ndarray, " point"]]:
        """Return points on the circle, and directions of its tangent there, rad."""
        turned = self.phase + self.sense * along / self.radius
        points = np.stack([np.cos(turned), np.sin(turned)], axis=1) * self.radius
        return points + np.array([self.x, self.y]), wrapped(turned + self.sense * np.pi / 2)


def wrapped(angle: Float64[np.ndarray, " point"]) -> Float64[np.ndarray, " point"]:
    """Return the same angles in [-π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def path_of(points: Float64[np.ndarray, "point 2"]) -> Polyline | Arc:
    """Return the line through some points: an arc if they are on a circle, else a polyline."""
    moved = np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 0])
    distinct = points[moved]
    return _arc_of(distinct) or Polyline(distinct)


def _arc_of(points: Float64[np.ndarray, "point 2"]) -> Arc | None:
    if len(points) < _LEAST_POINTS:
        return None
    first, middle, last = points[0], points[len(points) // 2], points[-1]
    system = 2 * np.array([middle - first, last - first])
    if abs(np.linalg.det(system)) < ARC_TOLERANCE:
        return None
    sides = [middle @ middle - first @ first, last @ last - first @ first]
    centre = np.linalg.solve(system, np.array(sides))
    away = points - centre
    radius = float(np.hypot(*away[0]))
    if radius > _LARGEST_RADIUS or (abs(np.hypot(*away.T) - radius) > ARC_TOLERANCE).any():
        return None
    phases = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    turn = float(phases[-1] - phases[0])
    if abs(turn) > np.pi:
        return None
    sense = float(np.sign(turn))
    x, y = centre.tolist()
    return Arc(x, y, radius, float(phases[0]), sense, radius * abs(turn))
