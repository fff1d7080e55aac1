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

from socialiq.physics import wrapped
from socialiq_recordings.conflicts.encounters import Encounters
from socialiq_recordings.conflicts.ways import Way, in_the_way, leader, on_way, projected, recorded
from socialiq_recordings.recording import PEOPLE
from socialiq_recordings.road.network import Sign
from socialiq_recordings.road.routes import Scene
from socialiq_recordings.world.config import SUB_STEPS

SPACING = 1.0  # m between the points of a line
FASTEST = 45.0  # m/s; no speed limit of a curve is higher
_AROUND = 5  # points before and behind between which a direction changes
_SLOWING = 1.5  # m/s²; deceleration before a curve
_PROBED = 2.0  # m between the points of a way that are looked for on another
_REACH = 3.0  # m; wider than any lane position that could be in the way

Line = Float64[np.ndarray, "point 3"]
"""Points of a way, one every `SPACING` m: x and y in m, direction in rad."""


def line_of(way: Way) -> Line:
    """Return the line of a way; it ends at the last whole `SPACING`."""
    at = np.arange(0.0, max(way.line.length, 2 * SPACING), SPACING)
    points, _ = way.line.points_at(at)
    steps = np.diff(points, axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    return np.column_stack([points, np.append(heading, heading[-1])])


def curvature(line: Line) -> Float64[np.ndarray, " point"]:
    """Return the curvature of a line over 10 m around each point, 1/m, without its sign."""
    turned = np.unwrap(line[:, 2])
    places = np.arange(len(turned))
    low = np.maximum(places - _AROUND, 0)
    high = np.minimum(places + _AROUND, len(turned) - 1)
    return np.abs(turned[high] - turned[low]) / (np.maximum(high - low, 1) * SPACING)


def speed_limits(line: Line, lateral: float) -> Float64[np.ndarray, " point"]:
    """Return the largest speed at each point of a line that a vehicle can drive in its curves, m/s.

    The speed keeps v² κ <= `lateral`, with a comfortable deceleration before a curve.

    Args:
        line: Points of the way.
        lateral: Largest lateral acceleration, m/s².
    """
    limit = np.minimum(np.sqrt(lateral / np.maximum(curvature(line), 1e-6)), FASTEST)
    for point in range(len(limit) - 2, -1, -1):
        ahead = np.sqrt(limit[point + 1] ** 2 + 2 * _SLOWING * SPACING)
        limit[point] = min(limit[point], ahead)
    return limit


def states_of(way: Way, first_frame: int) -> tuple[int, Float64[np.ndarray, "step 2"]]:
    """Return a way's states at the sub-steps of the simulator, interpolated between frames.

    Args:
        way: Way of the vehicle.
        first_frame: First frame of the recording, from which sub-steps count.

    Returns:
        The sub-step of the first state, and for each sub-step coordinate, m, and speed, m/s.
    """
    times = (np.arange(way.first, way.last + 1) - first_frame) * way.dt
    first, at = sub_steps_of(times)
    columns = np.interp(at, times, way.along), np.interp(at, times, way.speed)
    return first, np.column_stack(columns)


def sub_steps_of(
    times: Float64[np.ndarray, " state"],
) -> tuple[int, Float64[np.ndarray, " step"]]:
    """Return the first sub-step of a track, and the times of all of them, by its times, s."""
    first = int(np.ceil(times[0] * SUB_STEPS - 1e-6))
    last = max(int(np.floor(times[-1] * SUB_STEPS + 1e-6)), first)
    return first, np.arange(first, last + 1) / SUB_STEPS


def stretches(leading: Way, following: Way, slack: float) -> Float64[np.ndarray, "stretch 4"]:
    """Return the parts of a leading way that lie in a following one, driven in the same direction.

    Args:
        leading: Way of the vehicle ahead.
        following: Way of the vehicle behind.
        slack: Width by which vehicles are narrower than recorded, m.

    Returns:
        Begin and end of each part on the leading way, then on the following one, m.
    """
    first, second = (way.line.points for way in (leading, following))
    apart = np.maximum(
        first.min(axis=0) - second.max(axis=0), second.min(axis=0) - first.max(axis=0)
    )
    if (apart > 2 * _REACH).any():
        return np.zeros((0, 4))
    at = np.arange(0.0, leading.line.length, _PROBED)
    points, heading = leading.line.points_at(at)
    positions = following.line.coordinates(points[:, 0], points[:, 1])
    turned = wrapped(heading - positions.heading)
    widths = np.full(len(at), leading.width)
    inside = in_the_way(following, positions.lateral, turned, widths, slack)
    inside &= (positions.along >= 0) & (positions.along <= following.line.length)
    inside[1:] &= (np.diff(positions.along) > 0) | ~inside[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    ends = edges.reshape(-1, 2) - np.array([0, 1])
    ends = ends[ends[:, 1] > ends[:, 0]]
    return np.column_stack([at[ends], positions.along[ends]])


STANDING = 0.5  # m/s; a slower vehicle stands
_AHEAD = 12.0  # m; a leader within this distance is what a vehicle stands behind
_START = 2.0  # s from a reason's end to motion: the start-up lost time (HCM 2016, ch. 19)
_SOON = 5.0  # s; a conflicting vehicle that arrives later is no reason to stand
_UNEXPLAINED = 1.0  # s for which a vehicle must stand without a reason
_BEFORE = 1.0  # m between the front of the standing vehicle and the line
_EVERY = 0.5  # s between the moments at which a reason is looked for
_BESIDE = 1.5  # m; ways that pass further beside a line are of another lane


class Closure(NamedTuple):
    """Line that is closed to a lane."""

    x: float  # m to the east
    y: float  # m to the north
    heading: float  # direction of the lane, rad
    begin: float  # s from the recording's first frame; minus infinity if from its start
    end: float  # s; infinity if to its end


def closures_of(encounters: Encounters, first_frame: int) -> list[Closure]:
    """Return the lines that were closed, one for each vehicle that stood without a known reason.

    A vehicle must be the first of its lane, and its stand unexplained for `_UNEXPLAINED` s. On a
    map that marks lights, only a route with a light is closed.

    Args:
        encounters: Encounters of a recording.
        first_frame: First frame of the recording, from which the times of closures count.
    """
    closures = []
    lanelets = encounters.scene.lanes.road.lanelets
    lit = {number for number, lanelet in lanelets.items() if lanelet.sign == Sign.LIGHT}
    for way in encounters.ways.values():
        if lit and not lit.intersection(way.lanelets):
            continue
        standing = np.concatenate([[False], way.speed < STANDING, [False]])
        edges = np.flatnonzero(np.diff(standing.astype(np.int8))).reshape(-1, 2)
        for begin, end in (way.first + edges).tolist():
            step = max(1, round(_EVERY / way.dt))
            frames = range(begin, end, step)
            without = sum(not _has_reason(encounters, way, frame) for frame in frames)
            if without * step * way.dt < _UNEXPLAINED:
                continue
            start = first_frame * way.dt
            passed = -math.inf
            point, heading = way.line.points_at(
                np.array([way.state(begin)[0] + way.length / 2 + _BEFORE])
            )
            x, y = point[0].tolist()
            line = Closure(x, y, float(heading[0]), -math.inf, math.inf)
            for partner in encounters.in_time.earlier(begin):
                if partner.first + encounters.in_time.longest < passed:
                    break  # who is seen earlier passed earlier
                if partner.track != way.track:
                    for at, *_ in on_way_of(partner, [line]):
                        time = partner.reached(at - partner.length / 2)
                        passed = max(passed, time) if time <= begin else passed
            if math.isfinite(passed):
                line = line._replace(begin=passed * way.dt - start)
            if end <= way.last:
                line = line._replace(end=end * way.dt - start)
            closures.append(line)
    return closures


def on_way_of(way: Way, closures: list[Closure]) -> list[tuple[float, float, float]]:
    """Return the closures that a vehicle on a way meets, the nearest to its start first.

    Args:
        way: Way of the vehicle.
        closures: Closed lines of the recording.

    Returns:
        For each the coordinate of the line on the way, m, and its begin and end, s.
    """
    if not closures:
        return []
    x, y, heading = np.array(closures)[:, :3].T
    low = way.line.points.min(axis=0) - _BESIDE
    high = way.line.points.max(axis=0) + _BESIDE
    near = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
    if not len(near):
        return []
    positions = way.line.coordinates(x[near], y[near])
    turned = np.abs(wrapped(positions.heading - heading[near]))
    inside = (positions.along > 0) & (positions.along < way.line.length)
    inside &= (np.abs(positions.lateral) < _BESIDE) & (turned < math.pi / 6)
    met = zip(near[inside].tolist(), positions.along[inside].tolist(), strict=True)
    return sorted((at, closures[number].begin, closures[number].end) for number, at in met)


def _walks_ahead(scene: Scene, way: Way, frame: int) -> bool:
    tracks = scene.tracks
    rows = np.flatnonzero(
        np.isin(tracks.road_user, PEOPLE)[tracks.track]
        & (abs(tracks.frame - frame) * tracks.dt <= _START)
    )
    if not len(rows):
        return False
    places = way.line.coordinates(tracks.x[rows], tracks.y[rows])
    beside = (way.width + tracks.width[tracks.track[rows]]) / 2
    ahead = places.along - way.state(frame)[0]
    return bool(((abs(places.lateral) < beside) & (ahead > 0) & (ahead < _AHEAD)).any())


def _has_reason(encounters: Encounters, way: Way, frame: int) -> bool:
    """Whether a vehicle stands behind another, before one that arrives, or behind all areas.

    Or before a pedestrian or cyclist that is in its way, or was or will be by `_START` s.
    """
    along, _ = way.state(frame)
    vehicles = on_way(encounters.scene, way, frame, encounters.config.slack)
    if leader(way, along, vehicles).gap < _AHEAD or _walks_ahead(encounters.scene, way, frame):
        return True
    now = frame * way.dt
    met = False
    for partner in encounters.in_time.between(frame, frame):
        if partner.track == way.track:
            continue
        area = encounters.area(way.track, partner.track)
        if area is None or along + way.length / 2 > area.exit[0]:
            continue
        met = True
        times = projected(partner, area.entry[1], area.exit[1], frame)
        if times.leaves > now and times.enters < now + _SOON:
            return True
        # Courtesy: who is let go first arrives by starting, not at the speed of this moment, and
        # the one that stands goes after it.
        first = recorded(partner, area.entry[1], area.exit[1])
        goes = recorded(way, area.entry[0], area.exit[0]).enters
        if first.enters < now + _SOON and now < first.leaves + _START and goes < np.inf:
            return True
    areas = (encounters.area(way.track, track) for track in encounters.ways if track != way.track)
    return not met and not any(area is not None and area.entry[0] > along for area in areas)
