"""Ways of recorded vehicles as lines that the compiled core reads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from socialiq_recordings.conflicts.around import in_the_way
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.road.paths import wrapped
from socialiq_recordings.world.config import SUB_STEPS

SPACING = 1.0
"""m between the points of a line."""

FASTEST = 45.0
"""m/s; no speed limit of a curve is higher."""

_AROUND = 5  # points before and behind between which a direction changes
_SLOWING = 1.5  # m/s²; deceleration before a curve
_PROBED = 2.0  # m between the points of a way that are looked for on another
_REACH = 3.0  # m; wider than any lane position that could be in the way


class Line(NamedTuple):
    """Line of a way, a point every `SPACING` m.

    Attributes:
        x: m to the east.
        y: m to the north.
        heading: Direction, rad.
    """

    x: Float64[np.ndarray, " point"]
    y: Float64[np.ndarray, " point"]
    heading: Float64[np.ndarray, " point"]


def line_of(way: Way) -> Line:
    """Return the line of a way; it ends at the last whole `SPACING`."""
    at = np.arange(0.0, max(way.line.length, 2 * SPACING), SPACING)
    points, _ = way.line.points_at(at)
    steps = np.diff(points, axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    return Line(points[:, 0].copy(), points[:, 1].copy(), np.append(heading, heading[-1]))


def curvature(line: Line) -> Float64[np.ndarray, " point"]:
    """Return the curvature of a line over 10 m around each point, 1/m, without its sign."""
    turned = np.unwrap(line.heading)
    places = np.arange(len(turned))
    low = np.maximum(places - _AROUND, 0)
    high = np.minimum(places + _AROUND, len(turned) - 1)
    return np.abs(turned[high] - turned[low]) / (np.maximum(high - low, 1) * SPACING)


def speed_limits(line: Line, lateral: float) -> Float64[np.ndarray, " point"]:
    """Return the speed at each point that keeps a lateral acceleration there and ahead, m/s.

    v² κ <= lateral, with a comfortable deceleration before a curve.

    Args:
        line: The line.
        lateral: Largest lateral acceleration, m/s².
    """
    limit = np.minimum(np.sqrt(lateral / np.maximum(curvature(line), 1e-6)), FASTEST)
    for place in range(len(limit) - 2, -1, -1):
        ahead = np.sqrt(limit[place + 1] ** 2 + 2 * _SLOWING * SPACING)
        limit[place] = min(limit[place], ahead)
    return limit


class States(NamedTuple):
    """Recorded states of a way at the sub-steps of the simulator.

    Attributes:
        first: Sub-step of the first state, from the recording's first frame.
        along: Coordinate, m.
        speed: m/s.
    """

    first: int
    along: Float64[np.ndarray, " step"]
    speed: Float64[np.ndarray, " step"]


def states_of(way: Way, first_frame: int) -> States:
    """Return a way's states at the sub-steps of the simulator, interpolated between frames.

    Args:
        way: The way.
        first_frame: First frame of the recording.
    """
    times = (np.arange(way.first, way.last + 1) - first_frame) * way.dt
    first = int(np.ceil(times[0] * SUB_STEPS - 1e-6))
    last = max(int(np.floor(times[-1] * SUB_STEPS + 1e-6)), first)
    at = np.arange(first, last + 1) / SUB_STEPS
    return States(first, np.interp(at, times, way.along), np.interp(at, times, way.speed))


class Stretch(NamedTuple):
    """Part of one way that lies in another, driven in the same direction.

    Attributes:
        begin: Coordinate on the first way, m.
        end: Coordinate on the first way, m.
        other_begin: The same place on the second way, m.
        other_end: m.
    """

    begin: float
    end: float
    other_begin: float
    other_end: float


def stretches(leading: Way, following: Way, slack: float) -> list[Stretch]:
    """Return the parts of a way on which its vehicle is ahead of or behind another's.

    Args:
        leading: Way of the vehicle that is looked for.
        following: Way on which it is looked for.
        slack: m by which vehicles are narrower than recorded.
    """
    if not _boxes_meet(leading, following):
        return []
    at = np.arange(0.0, leading.line.length, _PROBED)
    points, heading = leading.line.points_at(at)
    seen = following.line.coordinates(points[:, 0], points[:, 1])
    inside = in_the_way(
        following,
        seen.lateral,
        wrapped(heading - seen.heading),
        np.full(len(at), leading.width),
        slack,
    )
    inside &= (seen.along >= 0) & (seen.along <= following.line.length)
    inside[1:] &= (np.diff(seen.along) > 0) | ~inside[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    found = []
    for begin, end in edges.reshape(-1, 2).tolist():
        if end - begin >= 2:
            last = end - 1
            places = at[begin], at[last], seen.along[begin], seen.along[last]
            found.append(Stretch(*(float(one) for one in places)))
    return found


def _boxes_meet(one: Way, other: Way) -> bool:
    boxes = [
        (way.line.points.min(axis=0) - _REACH, way.line.points.max(axis=0) + _REACH)
        for way in (one, other)
    ]
    return bool((boxes[0][0] <= boxes[1][1]).all() and (boxes[1][0] <= boxes[0][1]).all())
