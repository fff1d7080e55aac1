"""Ways of recorded vehicles as lines that the compiled core reads, and lines that were closed.

Recordings seldom have the lights' states. Where the first vehicle of a lane stands although no
vehicle with a conflicting way arrives soon, something holds it that the drivers' model doesn't
know: a light, a pedestrian. Its lane is closed in front of it, from the last vehicle that passed
until it moves; to the end of an episode, if it doesn't.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.ways import Way, in_the_way, leader, on_way, projected
from socialiq_recordings.physics import wrapped
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
    for point in range(len(limit) - 2, -1, -1):
        ahead = np.sqrt(limit[point + 1] ** 2 + 2 * _SLOWING * SPACING)
        limit[point] = min(limit[point], ahead)
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
    positions = following.line.coordinates(points[:, 0], points[:, 1])
    inside = in_the_way(
        following,
        positions.lateral,
        wrapped(heading - positions.heading),
        np.full(len(at), leading.width),
        slack,
    )
    inside &= (positions.along >= 0) & (positions.along <= following.line.length)
    inside[1:] &= (np.diff(positions.along) > 0) | ~inside[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    lying = []
    for begin, end in edges.reshape(-1, 2).tolist():
        if end - begin >= 2:
            last = end - 1
            places = at[begin], at[last], positions.along[begin], positions.along[last]
            lying.append(Stretch(*(float(coordinate) for coordinate in places)))
    return lying


def _boxes_meet(one: Way, other: Way) -> bool:
    boxes = [
        (way.line.points.min(axis=0) - _REACH, way.line.points.max(axis=0) + _REACH)
        for way in (one, other)
    ]
    return bool((boxes[0][0] <= boxes[1][1]).all() and (boxes[1][0] <= boxes[0][1]).all())


STANDING = 0.5
"""m/s; a slower vehicle stands."""

_AHEAD = 12.0  # m; a leader within this distance is what a vehicle stands behind
_SOON = 5.0  # s; a conflicting vehicle that arrives later is no reason to stand
_UNEXPLAINED = 1.0  # s for which a vehicle must stand without a reason
_BEFORE = 1.0  # m between the front of the standing vehicle and the line
_EVERY = 0.5  # s between the moments at which a reason is looked for
_BESIDE = 1.5  # m; ways that pass further beside a line are of another lane


class Closure(NamedTuple):
    """Line that is closed to a lane.

    Attributes:
        x: m to the east.
        y: m to the north.
        heading: Direction of the lane, rad.
        begin: s from the recording's first frame; minus infinity if from its start.
        end: s; infinity if to its end.
    """

    x: float
    y: float
    heading: float
    begin: float
    end: float


class Closed(NamedTuple):
    """Closure as a vehicle on one way meets it.

    Attributes:
        at: Coordinate of the line on the way, m.
        begin: s.
        end: s.
    """

    at: float
    begin: float
    end: float


def closures_of(encounters: Encounters, first_frame: int) -> list[Closure]:
    """Return the lines that were closed, one for each vehicle that stood without a known reason.

    Args:
        encounters: Of the recording.
        first_frame: First frame of the recording.
    """
    closures = []
    for way in encounters.ways.values():
        for begin, end in _stands(way):
            if _unexplained(encounters, way, begin, end) >= _UNEXPLAINED:
                closures.append(_closure(encounters, way, begin, end, first_frame))
    return closures


def on_way_of(way: Way, closures: list[Closure]) -> list[Closed]:
    """Return the closures that a vehicle on a way meets, the nearest to its start first."""
    if not closures:
        return []
    x, y, heading = (np.array(column) for column in list(zip(*closures, strict=True))[:3])
    low, high = way.line.points.min(axis=0) - _BESIDE, way.line.points.max(axis=0) + _BESIDE
    places = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
    if not len(places):
        return []
    positions = way.line.coordinates(x[places], y[places])
    turned = np.abs(wrapped(positions.heading - heading[places]))
    inside = (positions.along > 0) & (positions.along < way.line.length)
    inside &= (np.abs(positions.lateral) < _BESIDE) & (turned < math.pi / 6)
    met = zip(places[inside].tolist(), positions.along[inside].tolist(), strict=True)
    return sorted(Closed(at, closures[number].begin, closures[number].end) for number, at in met)


def _stands(way: Way) -> list[tuple[int, int]]:
    """Return the first frame of each stand, and the frame after its last."""
    standing = np.concatenate([[False], way.speed < STANDING, [False]])
    edges = np.flatnonzero(np.diff(standing.astype(np.int8))).reshape(-1, 2)
    return [(way.first + int(a), way.first + int(b)) for a, b in edges]


def _unexplained(encounters: Encounters, way: Way, begin: int, end: int) -> float:
    """Return for how long a vehicle stood first in its lane without a reason, s."""
    step = max(1, round(_EVERY / way.dt))
    frames = range(begin, end, step)
    return sum(not _has_reason(encounters, way, frame) for frame in frames) * step * way.dt


def _has_reason(encounters: Encounters, way: Way, frame: int) -> bool:
    along, _ = way.state(frame)
    vehicles = on_way(encounters.scene, way, frame, encounters.config.slack)
    if leader(way, along, vehicles).gap < _AHEAD:
        return True
    now, met = frame * way.dt, False
    for partner in encounters.in_time.seen(frame, frame):
        if partner.track == way.track:
            continue
        area = encounters.area(way.track, partner.track)
        if area is None or along + way.length / 2 > area.exit[0]:
            continue
        met = True
        times = projected(partner, area.entry[1], area.exit[1], frame)
        if times.leaves > now and times.enters < now + _SOON:
            return True
    # Behind the last conflict area, or on a road without one, a stand has another reason.
    return not met and not _areas_ahead(encounters, way, along)


def _areas_ahead(encounters: Encounters, way: Way, along: float) -> bool:
    for partner in encounters.ways.values():
        if partner.track != way.track:
            area = encounters.area(way.track, partner.track)
            if area is not None and area.entry[0] > along:
                return True
    return False


def _closure(encounters: Encounters, way: Way, begin: int, end: int, first_frame: int) -> Closure:
    along, _ = way.state(begin)
    at = along + way.length / 2 + _BEFORE
    point, heading = way.line.points_at(np.array([at]))
    x, y = point[0].tolist()
    passed = -math.inf
    for partner in encounters.in_time.earlier(begin):
        if partner.first + encounters.in_time.longest < passed:
            break  # who is seen earlier passed earlier
        if partner.track == way.track:
            continue
        closed = on_way_of(partner, [Closure(x, y, float(heading[0]), 0.0, 0.0)])
        if closed:
            time = partner.reached(closed[0].at - partner.length / 2)
            if time <= begin:
                passed = max(passed, time)
    start = first_frame * way.dt
    released = end <= way.last
    return Closure(
        x,
        y,
        float(heading[0]),
        passed * way.dt - start if math.isfinite(passed) else -math.inf,
        end * way.dt - start if released else math.inf,
    )
