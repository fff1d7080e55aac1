"""Lines that were closed to a lane for a time, as by a red light, inferred from standing vehicles.

Recordings seldom have the lights' states. Where the first vehicle of a lane stands although no
vehicle with a conflicting way arrives soon, something holds it that the drivers' model doesn't
know: a light, a pedestrian. Its lane is closed in front of it, from the last vehicle that passed
until it moves; to the end of an episode, if it doesn't.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from socialiq_recordings.conflicts import occupancy
from socialiq_recordings.conflicts.around import leader, on_way
from socialiq_recordings.conflicts.pairs import Encounters
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.road.paths import wrapped

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
    found = []
    for way in encounters.ways.values():
        for begin, end in _stands(way):
            if _unexplained(encounters, way, begin, end) >= _UNEXPLAINED:
                found.append(_closure(encounters, way, begin, end, first_frame))
    return found


def on_way_of(way: Way, closures: list[Closure]) -> list[Closed]:
    """Return the closures that a vehicle on a way meets, the nearest to its start first."""
    if not closures:
        return []
    x, y, heading = (np.array(column) for column in list(zip(*closures, strict=True))[:3])
    low, high = way.line.points.min(axis=0) - _BESIDE, way.line.points.max(axis=0) + _BESIDE
    places = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
    if not len(places):
        return []
    seen = way.line.coordinates(x[places], y[places])
    turned = np.abs(wrapped(seen.heading - heading[places]))
    inside = (seen.along > 0) & (seen.along < way.line.length)
    inside &= (np.abs(seen.lateral) < _BESIDE) & (turned < math.pi / 6)
    met = zip(places[inside].tolist(), seen.along[inside].tolist(), strict=True)
    return sorted(Closed(at, closures[one].begin, closures[one].end) for one, at in met)


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
    others = on_way(encounters.scene, way, frame, encounters.config.slack)
    if leader(way, along, others).gap < _AHEAD:
        return True
    now, met = frame * way.dt, False
    for other in encounters.in_time.seen(frame, frame):
        if other.track == way.track:
            continue
        area = encounters.area(way.track, other.track)
        if area is None or along + way.length / 2 > area.exit[0]:
            continue
        met = True
        times = occupancy.projected(other, area.entry[1], area.exit[1], frame)
        if times.leaves > now and times.enters < now + _SOON:
            return True
    # Behind the last conflict area, or on a road without one, a stand has another reason.
    return not met and not _areas_ahead(encounters, way, along)


def _areas_ahead(encounters: Encounters, way: Way, along: float) -> bool:
    for other in encounters.ways.values():
        if other.track != way.track:
            area = encounters.area(way.track, other.track)
            if area is not None and area.entry[0] > along:
                return True
    return False


def _closure(encounters: Encounters, way: Way, begin: int, end: int, first_frame: int) -> Closure:
    along, _ = way.state(begin)
    at = along + way.length / 2 + _BEFORE
    point, heading = way.line.points_at(np.array([at]))
    x, y = point[0].tolist()
    passed = -math.inf
    for other in encounters.in_time.earlier(begin):
        if other.first + encounters.in_time.longest < passed:
            break  # who is seen earlier passed earlier
        if other.track == way.track:
            continue
        closed = on_way_of(other, [Closure(x, y, float(heading[0]), 0.0, 0.0)])
        if closed:
            time = other.reached(closed[0].at - other.length / 2)
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
