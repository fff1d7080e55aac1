"""Measures of a conflict by their published definitions, and the table of conflicts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool

from socialiq.physics import wrapped
from socialiq.types import Row
from socialiq_recordings.conflicts.encounters import Encounters, Meeting
from socialiq_recordings.conflicts.ways import Occupancy, Way, frames_together, recorded
from socialiq_recordings.recording import RoadUser
from socialiq_recordings.road.network import Conflict, Sign


def post_encroachment_time(first_leaves: float, second_arrives: float) -> float:
    """Return the post-encroachment time (PET) of a conflict area, s.

    The time between the two vehicles in the area (Allen, Shin and Cooper 1978, Transportation
    Research Record 667).

    Args:
        first_leaves: Time at which the first vehicle's rear leaves the area, s.
        second_arrives: Time at which the second vehicle's front arrives at it, s.

    Returns:
        Below 0 if both were in it at once.
    """
    return second_arrives - first_leaves


def time_to_collision(gap: float, speed: float, leader_speed: float) -> float:
    """Return the time to collision (TTC) with a leader on the same path, s.

    Time until two vehicles collide if both keep their speeds and paths (Hayward 1972, Highway
    Research Record 384).

    Args:
        gap: Distance from the follower's front to the leader's rear, m.
        speed: Speed of the follower, m/s.
        leader_speed: Speed of the leader, m/s.

    Returns:
        Infinite if the gap does not close; 0 if there is no gap.
    """
    if gap <= 0:
        return 0.0
    closing = speed - leader_speed
    return gap / closing if closing > 0 else math.inf


def time_to_collision_crossing(first: tuple[float, float], second: tuple[float, float]) -> float:
    """Return the time to collision of two vehicles on paths that cross, s.

    With present speeds and paths they collide if both are in the conflict area at one time, when
    the later one arrives (Hayward 1972; for right angles van der Horst 1990, A time-based analysis
    of road user behaviour in normal and critical encounters, TU Delft).

    Args:
        first: Times of the first vehicle, s from now: until its front arrives at the area, and
            until its rear leaves it. Infinite for never.
        second: The same times of the second vehicle.

    Returns:
        Infinite if the vehicles do not collide; 0 if both are in the area now.
    """
    arrives = max(first[0], second[0])
    meet = arrives < min(first[1], second[1])
    return max(arrives, 0.0) if meet and math.isfinite(arrives) else math.inf


def required_deceleration(gap: float, speed: float, leader_speed: float) -> float:
    """Return the deceleration rate to avoid a crash with a leader (DRAC), m/s².

    The constant deceleration at which the follower reaches the leader's speed as the gap closes, (v
    - v_l)² / (2 gap) (Cooper and Ferguson 1976, Traffic Engineering and Control 17).

    Args:
        gap: Distance from the follower's front to the leader's rear, m.
        speed: Speed of the follower, m/s.
        leader_speed: Speed of the leader, m/s.

    Returns:
        0 if the gap does not close; infinite if there is no gap.
    """
    closing = speed - leader_speed
    if closing <= 0:
        return 0.0
    return closing**2 / (2 * gap) if gap > 0 else math.inf


def required_deceleration_crossing(gap: float, speed: float, seconds: float) -> float:
    """Return the least constant deceleration to arrive at a conflict area after some time, m/s².

    The crossing form of the same measure (Cooper and Ferguson 1976; Gettman and Head 2003,
    FHWA-RD-03-050): a vehicle that brakes from now on has not arrived before the first one has
    left. Either it still moves then, v t - b t²/2 = gap, or it has stopped at the area, b = v²/(2
    gap).

    Args:
        gap: Distance from the vehicle's front to the area, m.
        speed: Speed of the vehicle, m/s.
        seconds: Time until the first one has left, s; infinite if it stands in the area.

    Returns:
        0 if the vehicle stands or arrives later at its speed; infinite if it would arrive earlier
        and has no gap.
    """
    if speed <= 0 or speed * seconds <= gap:
        return 0.0
    if gap <= 0:
        return math.inf
    if speed * seconds >= 2 * gap:
        return speed**2 / (2 * gap)
    return 2 * (speed * seconds - gap) / seconds**2


LARGEST_BRAKING = 10.0  # m/s²; a tyre or a shoe on a dry road decelerates by no more
UNAVOIDABLE = "unavoidable"
"""In the place of a required deceleration above `LARGEST_BRAKING`."""

_OF_ORDER = (
    *("ego_first", "pet", "ttc", "gap_accepted", "lag_accepted", "ego_lost", "other_lost"),
    *("required_deceleration", "other_required_deceleration"),
)
"""Columns that depend on who goes first."""

_DECIDING = 5.0  # s before the first enters an area in which speeds show who would be first
_TURN_BEFORE = 30.0  # m before an area, from which on the turn of a way is measured
_TURN_AFTER = 20.0  # m behind an area, up to which it is measured


def rows_of(encounters: Encounters, meetings: Sequence[Meeting]) -> list[Row]:
    """Return a row for each conflict of a recording; a number that isn't known is None.

    Args:
        encounters: Encounters of the recording.
        meetings: Conflicts to describe, each an ordered pair.

    Returns:
        Rows in the order of `meetings`. `ego` and `other` are the numbers of the vehicles in the
        file. Angles and turns are in degrees, places in m, speeds in m/s, decelerations in m/s²;
        times are in s, those of entering and leaving from frame 0. A required deceleration may be
        `UNAVOIDABLE`. Those who meet head-on in shared space have a lateral clearance in the place
        of all that depends on who goes first.
    """
    tracks = encounters.scene.tracks
    rows = []
    identity = tracks.identity
    for meeting in meetings:
        area = meeting.area
        ego = meeting.ego
        partner = meeting.other
        gap, lag = gaps(encounters, meeting)
        times = meeting.ego_times
        other_times = meeting.other_times
        now = (meeting.frames * meeting.ego.dt)[:, None]
        first, second = (times - now for times in meeting.times)
        # At other moments vehicles that cross would not be in the area at one time.
        meet = np.maximum(first, second)[:, 0] < np.minimum(first, second)[:, 1]
        moments = _moments(meeting, meet | (meeting.area.kind == Conflict.MERGING))
        row: Row = {
            "recording": tracks.recording,
            "ego": int(identity[ego.track]),
            "other": int(identity[partner.track]),
            "kind": "head_on" if meeting.is_head_on else area.kind.name.lower(),
            "angle": area.angle,
            "x": area.x,
            "y": area.y,
            "ego_turn": turn(ego, area.entry[0], area.exit[0]),
            "other_turn": turn(partner, area.entry[1], area.exit[1]),
            "ego_sign": sign(encounters, ego, partner),
            "other_sign": sign(encounters, partner, ego),
            "ego_route_seen": bool(ego.along[-1] + ego.length / 2 >= area.entry[0]),
            "other_route_seen": bool(partner.along[-1] + partner.length / 2 >= area.entry[1]),
            "ego_first": meeting.ego_first,
            "complete": meeting.complete,
            "seconds": len(meeting.frames) * ego.dt,
            "pet": pet(meeting),
            "ttc": min((ttc_at(meeting, *moment) for moment in moments), default=math.inf),
            "lateral_clearance": lateral_clearance(encounters, meeting),
            "required_deceleration": _needed(meeting),
            "other_required_deceleration": _needed(meeting.swapped()),
            "gap_accepted": gap,
            "lag_accepted": lag,
            "ego_enters": times.enters,
            "ego_leaves": times.leaves,
            "other_enters": other_times.enters,
            "other_leaves": other_times.leaves,
            "ego_class": RoadUser(tracks.road_user[ego.track]).name.lower(),
            "other_class": RoadUser(tracks.road_user[partner.track]).name.lower(),
            "ego_speed": _speed_at(ego, times.enters),
            "other_speed": _speed_at(partner, other_times.enters),
            "ego_lost": lost(meeting),
            "other_lost": lost(meeting.swapped()),
        }
        if meeting.is_head_on:
            row |= dict.fromkeys(_OF_ORDER)
        rows.append({name: finite_or_none(value) for name, value in row.items()})
    return rows


def lateral_clearance(encounters: Encounters, meeting: Meeting) -> float:
    """Return the least free space between two who meet head-on, m; NaN for others.

    It is the least distance of their middles less half of both widths, below 0 if they touched. NaN
    also if they are closest at the first or the last frame in view together.

    Args:
        encounters: Encounters of the recording, with the positions.
        meeting: Conflict of the two.
    """
    ways = meeting.ego, meeting.other
    frames = frames_together(*ways)
    if not meeting.is_head_on or not len(frames):
        return math.nan
    tracks = encounters.scene.tracks
    rows, other_rows = (tracks.starts[way.track] + frames - way.first for way in ways)
    apart = np.hypot(tracks.x[rows] - tracks.x[other_rows], tracks.y[rows] - tracks.y[other_rows])
    closest = int(apart.argmin())
    if closest in (0, len(frames) - 1):
        return math.nan
    return float(apart[closest]) - (ways[0].width + ways[1].width) / 2


def finite_or_none(value: object) -> object:
    """Return a cell, None for NaN or an infinite number."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _speed_at(way: Way, seconds: float) -> float:
    """Return the speed on the way at a time, m/s; NaN where it isn't in view."""
    inside = way.first <= seconds / way.dt <= way.last
    return way.state(round(seconds / way.dt))[1] if inside else math.nan


YIELDED = 1.0
"""s; who passes second and loses as much gave way. Speeds of pedestrians are known to a tenth, so
that times over some seconds err by half a second."""


def lost(meeting: Meeting) -> float:
    """Return the time that the ego lost before it entered the area, s; NaN if not recorded.

    It is the delay behind the earliest arrival that it once would have had at its speed, at a
    moment up to 5 s before the first of the two entered, both in view. A swerve without a loss of
    time is none, and whom a red light or a turn slows loses like others.
    """
    enters = meeting.ego_times.enters
    now = meeting.frames * meeting.ego.dt
    first = min(enters, meeting.other_times.enters)
    moments = (now <= first) & (now >= first - _DECIDING)
    if not (meeting.complete and math.isfinite(first) and moments.any()):
        return math.nan
    return max(float(enters - meeting.times[0][moments, 0].min()), 0.0)


def pet(meeting: Meeting) -> float:
    """Return the post-encroachment time, s; NaN if it wasn't recorded."""
    if not meeting.complete:
        return math.nan
    first, second = sorted((meeting.ego_times, meeting.other_times))
    return post_encroachment_time(first.leaves, second.enters)


Times = tuple[Occupancy, Occupancy]
"""Times of the ego and of the other in the area at their speeds of a frame."""


def _moments(meeting: Meeting, chosen: Bool[np.ndarray, " frame"]) -> Iterator[tuple[int, Times]]:
    """Yield some frames of a conflict, and the times in the area at their speeds."""
    times = (itertools.starmap(Occupancy, of_one[chosen].tolist()) for of_one in meeting.times)
    return zip(meeting.frames[chosen].tolist(), zip(*times, strict=True), strict=True)


def ttc_at(meeting: Meeting, frame: int, times: Times) -> float:
    """Return the time to collision at a frame, s.

    Where ways merge, the second vehicle may also reach the first behind the line.

    Args:
        meeting: Conflict of the two vehicles.
        frame: Frame of the recording, one of the conflict's.
        times: Times of the ego and of its partner in the area at their speeds of the frame.

    Returns:
        Infinite if they do not collide.
    """
    now = frame * meeting.ego.dt
    ego_times, other_times = ((times_in.enters - now, times_in.leaves - now) for times_in in times)
    crossing = time_to_collision_crossing(ego_times, other_times)
    if meeting.area.kind == Conflict.CROSSING or math.isfinite(crossing):
        return crossing
    first = 0 if times[0].enters <= times[1].enters else 1
    time = time_to_collision(*_following(meeting, first, frame))
    return time if time >= times[first].leaves - now else math.inf


def _following(meeting: Meeting, first: int, frame: int) -> tuple[float, float, float]:
    """Return gap and speeds of the second vehicle and the first, measured to the merging line."""
    ways = meeting.ego, meeting.other
    along, speed = zip(*(way.state(frame) for way in ways), strict=True)
    to_line = [meeting.area.entry[side] - along[side] for side in range(2)]
    gap = to_line[1 - first] - to_line[first] - (ways[0].length + ways[1].length) / 2
    return gap, speed[1 - first], speed[first]


def required_at(meeting: Meeting, frame: int, times: Times) -> float:
    """Return the deceleration that the ego needs at a frame, m/s²; 0 if it would arrive first.

    Where ways merge, it is the larger of the decelerations for the area and behind the leader.

    Args:
        meeting: Conflict of the two vehicles.
        frame: Frame of the recording, one of the conflict's.
        times: Times of the ego and of its partner in the area at their speeds of the frame.

    Returns:
        0 also if the ego is in the area already.
    """
    now = frame * meeting.ego.dt
    ego = meeting.ego
    ego_times, other_times = times
    if ego_times.enters <= other_times.enters or ego_times.enters <= now:
        return 0.0
    along, speed = ego.state(frame)
    gap = meeting.area.entry[0] - ego.length / 2 - along
    needed = required_deceleration_crossing(gap, speed, max(other_times.leaves - now, 0.0))
    if meeting.area.kind == Conflict.MERGING:
        needed = max(needed, required_deceleration(*_following(meeting, 1, frame)))
    return needed


def _hardest(meeting: Meeting) -> float:
    """Return the largest deceleration that the ego needs in the conflict, m/s²; NaN if unseen."""
    if not len(meeting.frames):
        return math.nan
    arrives, other_arrives = (times[:, 0] for times in meeting.times)
    # At other moments it needs none.
    late = (arrives > other_arrives) & (arrives > meeting.frames * meeting.ego.dt)
    moments = _moments(meeting, late)
    return max((required_at(meeting, *moment) for moment in moments), default=0.0)


def _needed(meeting: Meeting) -> float | str:
    """Return the largest deceleration that the ego needs, m/s², or `UNAVOIDABLE`."""
    hardest = _hardest(meeting)
    return UNAVOIDABLE if hardest > LARGEST_BRAKING else hardest


def gaps(encounters: Encounters, meeting: Meeting) -> tuple[float, float]:
    """Return the gap and the lag that the ego accepted before the second vehicle, s.

    The stream is the vehicles that enter the area by the second vehicle's lanelet (Raff and Hart
    1950, A volume warrant for urban stop signs, Eno Foundation). A gap is the time between the
    arrivals of the two of them between which the ego passed, front to front. A lag is the time from
    the ego's arrival to the next one's, where none came before.

    Args:
        encounters: Encounters of the recording, whose vehicles are the stream.
        meeting: Conflict of the ego with the second vehicle.

    Returns:
        Gap and lag; at most one of them is a number. NaN: not accepted, or not recorded.
    """
    after = meeting.other_times.enters
    arrives = meeting.ego_times.enters
    if not (meeting.complete and meeting.ego_first and meeting.other.lanelets):
        return math.nan, math.nan
    lanelet = _lanelet_at(encounters, meeting.other, meeting.area.entry[1])
    before = -math.inf
    between = False
    dt = meeting.ego.dt
    # Who is seen first after the other arrives is no next one of the stream.
    for way in encounters.in_time.earlier(after / dt):
        if (way.first + encounters.in_time.longest) * dt < before:
            break  # who is seen earlier entered earlier
        track = way.track
        if track in (meeting.ego.track, meeting.other.track) or not way.lanelets:
            continue
        area = encounters.area(meeting.ego.track, track)
        if area is None or _lanelet_at(encounters, way, area.entry[1]) != lanelet:
            continue
        enters = recorded(way, area.entry[1], area.exit[1]).enters
        before = max(before, enters) if enters <= arrives else before
        between = between or arrives < enters < after
    if between:
        return math.nan, math.nan  # another vehicle is the next of the stream
    if math.isinf(before):
        return math.nan, after - arrives
    return after - before, math.nan


def _lanelet_at(encounters: Encounters, way: Way, coordinate: float) -> int:
    """Return the lanelet nearest to a place on a way, among those of its route."""
    point = way.line.points_at(np.array([coordinate]))[0]
    return encounters.scene.matcher.nearest(point, way.lanelets)


def turn(way: Way, entry: float, end: float) -> float:
    """Return the change of direction over a conflict area, degrees, positive to the left.

    Args:
        way: Way of the vehicle.
        entry: Coordinate on it at which the area begins, m.
        end: Coordinate at which the area ends, m.

    Returns:
        The change from 30 m before the area to 20 m behind it, or on the part of it that the line
        has.
    """
    at = np.clip([entry - _TURN_BEFORE, end + _TURN_AFTER], 0.0, way.line.length)
    before, after = way.line.points_at(at)[1].tolist()
    return math.degrees(wrapped(after - before))


def sign(encounters: Encounters, way: Way, partner: Way) -> str:
    """Return the last right-of-way sign on a route up to the lanelet in conflict.

    Args:
        encounters: Encounters of the recording, whose map has the signs.
        way: Way of the vehicle, whose route is followed.
        partner: Way of the second vehicle, whose lanelets are in conflict with the route.

    Returns:
        Name of the `Sign` in small letters; "none" if the route has no sign, or no lanelet.
    """
    lanes = encounters.scene.lanes
    last = Sign.NONE
    crossed = None
    if way.lanelets and not partner.lanelets:
        area = encounters.area(way.track, partner.track)
        crossed = None if area is None else _lanelet_at(encounters, way, area.entry[0])
    for number in way.lanelets:
        last = lanes.road.lanelets[number].sign or last
        if number == crossed or not lanes.against[number].isdisjoint(partner.lanelets):
            break
    return Sign(last).name.lower()
