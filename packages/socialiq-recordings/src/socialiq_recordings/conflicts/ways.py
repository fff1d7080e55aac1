"""Ways of vehicles: the line that each drove, its times on it, and other vehicles on it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.physics import wrapped
from socialiq_recordings.road.paths import ROUNDING, Polyline, on_segments
from socialiq_recordings.road.routes import AHEAD, Scene

SPACING = 1.0  # m between the points of a driven line; shorter steps are noise of the positions
BEHIND = 10.0  # m of straight line before the first state
SMOOTHED = 1.0  # s; speeds over shorter times are mostly error in recordings from video
_ON_ROUTE = 3.5  # m; further beside its route a line goes straight on
_RETURN = 20.0  # m in which a line returns to the middle of its lane
_STEP = 2.0  # m between the points of a continued line


@dataclass(frozen=True, eq=False)
class Way:
    """Way of a vehicle."""

    track: int  # number of the track
    first: int  # its first frame
    # Of its middle: `BEHIND` m before its first state, as driven, up to `AHEAD` m along its route
    # if it has one.
    line: Polyline
    along: Float64[np.ndarray, " state"]  # coordinate on the line at each frame, m; never decreases
    speed: Float64[np.ndarray, " state"]  # along the line, m/s: the distance driven in `SMOOTHED`
    length: float  # of the vehicle, m
    width: float  # of the vehicle, m
    lanelets: tuple[int, ...]  # numbers of the lanelets on its route; none if it follows none
    dt: float  # s between frames

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Box around what the vehicle sweeps: its west, south, east and north, m."""
        return self._box(self.width / 2, len(self.line.points))

    def box_within(self, seconds: float) -> tuple[float, float, float, float]:
        """Return the box up to where its front drives, or is that long after at a frame's speed."""
        farthest = max(self.along[-1], (self.along + self.speed * seconds).max())
        last = self.line.starts.searchsorted(farthest + self.length / 2 + ROUNDING, side="right")
        return self._box(self.width / 2 + ROUNDING, int(last) + 1)

    def _box(self, half: float, points: int) -> tuple[float, float, float, float]:
        line = self.line.points[:points]
        west, south = (line.min(axis=0) - half).tolist()
        east, north = (line.max(axis=0) + half).tolist()
        return west, south, east, north

    @property
    def last(self) -> int:
        """Last frame."""
        return self.first + len(self.along) - 1

    def state(self, frame: int) -> tuple[float, float]:
        """Return coordinate and speed at a frame."""
        return float(self.along[frame - self.first]), float(self.speed[frame - self.first])

    def states(
        self, frames: Int64[np.ndarray, " frame"]
    ) -> tuple[Float64[np.ndarray, " frame"], Float64[np.ndarray, " frame"]]:
        """Return coordinates and speeds at some frames."""
        return self.along[frames - self.first], self.speed[frames - self.first]

    def reached(self, coordinate: float) -> float:
        """Return the frame, with a fraction, at which the middle reached a coordinate.

        Minus infinity if it was beyond at its first frame, infinity if it had not at its last.
        """
        if coordinate < self.along[0]:
            return -np.inf
        if coordinate > self.along[-1]:
            return np.inf
        index = int(np.searchsorted(self.along, coordinate, side="left"))
        if index == 0:
            return float(self.first)
        before, after = self.along[index - 1 : index + 1].tolist()
        return self.first + index - 1 + (coordinate - before) / (after - before)


def way_of(scene: Scene, track: int) -> Way:
    """Return the way of a vehicle.

    Args:
        scene: Recording on its road.
        track: Number of the vehicle's track.

    Returns:
        The line as driven, continued along the route, and coordinate and speed on it at each frame.
    """
    tracks = scene.tracks
    rows = scene.rows(track)
    points = np.stack([tracks.x[rows], tracks.y[rows]], axis=1)
    spaced = points[:1].tolist()
    passed = []
    for point in points.tolist():
        if math.dist(point, spaced[-1]) >= SPACING:
            spaced.append(point)
        passed.append(len(spaced))
    driven = np.array(spaced)
    heading = float(tracks.heading[rows.start])
    back = driven[0] - BEHIND * np.array([np.cos(heading), np.sin(heading)])
    onwards = _onwards(scene, track, driven[-1])
    line = Polyline(np.concatenate([back[None], driven, onwards]))
    # The coordinate of each state, searched near the one before, since a line may cross itself or
    # turn back beside itself: all at once, until those before are those that are found.
    along = line.starts[passed]
    begin = 0
    starts = line.starts
    while begin < len(points):
        coordinate = np.append(BEHIND, along)[begin:-1]
        low = np.maximum(starts.searchsorted(coordinate - 2 * SPACING, side="right") - 1, 0)
        count = starts.searchsorted(coordinate + 8.0, side="right") - low
        index = np.arange(len(low))
        columns = np.arange(count.max())
        segment = np.minimum(low[:, None] + columns, len(starts) - 1)
        low_end = np.zeros(segment.shape)
        high_end = line.lengths[segment]
        low_end[count > 1, 0] = -np.inf
        high_end[index, count - 1] = np.inf
        pieces = [*line.segments[:4, segment], low_end, high_end]
        inside, _, distance = on_segments(points[begin:, :1], points[begin:, 1:], *pieces)
        piece = np.where(columns < count[:, None], distance, np.inf).argmin(axis=1)
        before = np.cumsum(line.lengths[segment], axis=1)[index, piece - 1] * (piece > 0)
        reached = starts[low] + np.maximum(before + inside[index, piece], 0.0)
        reached = np.maximum.accumulate(np.maximum(reached, coordinate[0]))
        differs = np.flatnonzero(reached != along[begin:])
        along = np.append(along[:begin], reached)
        begin = begin + int(differs[0]) + 1 if len(differs) else len(points)
    # Central differences over `SMOOTHED`, one-sided at the ends; 0 for one state.
    half = max(round(SMOOTHED / tracks.dt / 2), 1)
    frames = np.arange(len(along))
    first = np.maximum(frames - half, 0)
    last = np.minimum(frames + half, len(along) - 1)
    speed = (along[last] - along[first]) / np.maximum((last - first) * tracks.dt, tracks.dt)
    states = int(tracks.frame[rows.start]), line, along, speed
    size = float(tracks.length[track]), float(tracks.width[track])
    lanelets = () if track in scene.free else scene.matched(track).lanelets
    return Way(track, *states, *size, lanelets, tracks.dt)


def _onwards(scene: Scene, track: int, last: np.ndarray) -> Float64[np.ndarray, "point 2"]:
    """Return points of the route beyond the last state, from the vehicle's offset to its middle.

    The way on of a road user without a route is not known.
    """
    metres = np.arange(_STEP, AHEAD, _STEP)
    heading = float(scene.tracks.heading[scene.rows(track).stop - 1])
    straight = last + metres[:, None] * np.array([np.cos(heading), np.sin(heading)])
    if track in scene.free:
        return straight[:1]
    matched = scene.matched(track)
    route = scene.matcher.section(list(matched.lanelets[int(matched.place[-1]) :]), AHEAD)
    if route is None:
        return straight
    position = route.coordinates(last[:1], last[1:])
    if abs(position.lateral[0]) > _ON_ROUTE:
        return straight
    ahead = float(position.along[0]) + metres
    inside = ahead <= max(route.length, float(position.along[0]) + _STEP)
    middle, direction = route.points_at(ahead[inside])
    offset = float(position.lateral[0]) * np.clip(1 - metres[inside] / _RETURN, 0.0, 1.0)
    left = np.stack([-np.sin(direction), np.cos(direction)], axis=1)
    return middle + offset[:, None] * left


def frames_together(first: Way, second: Way) -> Int64[np.ndarray, " frame"]:
    """Return the frames at which both vehicles are present.

    Args:
        first: Way of one vehicle.
        second: Way of the second vehicle.

    Returns:
        Frames in ascending order; empty if the vehicles are never present together.
    """
    return np.arange(max(first.first, second.first), min(first.last, second.last) + 1)


STANDING = 0.1  # m/s; a slower vehicle doesn't arrive at its present speed


class Occupancy(NamedTuple):
    """Times of a vehicle in a conflict area, s from the recording's frame 0."""

    enters: Any  # its front arrives; minus infinity if before its first frame, infinity if never
    leaves: Any  # its rear leaves


def recorded(way: Way, entry: float, end: float) -> Occupancy:
    """Return the recorded times of a vehicle in an area on its way.

    Args:
        way: Way of the vehicle.
        entry: Coordinate at which the area begins, m.
        end: Coordinate at which the area ends, m.

    Returns:
        Times in s from frame 0. Minus infinity: before the vehicle's first frame; infinity: not
        until its last.
    """
    half = way.length / 2
    return Occupancy(way.reached(entry - half) * way.dt, way.reached(end + half) * way.dt)


def projections(
    way: Way, entry: float, end: float, frames: Int64[np.ndarray, " frame"]
) -> Float64[np.ndarray, "frame 2"]:
    """Return the times of a vehicle in an area at the speed of each frame.

    Args:
        way: Way of the vehicle.
        entry: Coordinate at which the area begins, m.
        end: Coordinate at which the area ends, m.
        frames: Frames of the recording at which the vehicle is present.

    Returns:
        `enters` and `leaves` in s from frame 0, a row for each frame. A time that has passed at the
        frame is the recorded one; a later one is infinite for a vehicle slower than `STANDING`.
    """
    along, speed = way.states(frames)
    now = frames * way.dt
    past = recorded(way, entry, end)
    half = way.length / 2
    times = []
    moving = np.where(speed >= STANDING, speed, 1.0)
    for before, coordinate in zip(past, (entry - half, end + half), strict=True):
        later = np.where(speed >= STANDING, now + (coordinate - along) / moving, np.inf)
        times.append(np.where(coordinate <= along, before, later))
    return np.stack(times, axis=1)


def projected(way: Way, entry: float, end: float, frame: int) -> Occupancy:
    """Return the times of a vehicle in an area at its speed of one frame.

    Args:
        way: Way of the vehicle.
        entry: Coordinate at which the area begins, m.
        end: Coordinate at which the area ends, m.
        frame: Frame of the recording at which the vehicle is present.

    Returns:
        Times in s from frame 0, as `projections` returns them.
    """
    return Occupancy(*projections(way, entry, end, np.array([frame]))[0].tolist())


def expected(way: Way, entry: float, end: float) -> Occupancy:
    """Return the recorded times in an area, or those projected where they were not recorded.

    Args:
        way: Way of the vehicle.
        entry: Coordinate at which the area begins, m.
        end: Coordinate at which the area ends, m.

    Returns:
        Times in s from frame 0. What comes after the vehicle's last frame is projected at the speed
        of that frame.
    """
    later = projected(way, entry, end, way.last)
    pairs = zip(recorded(way, entry, end), later, strict=True)
    return Occupancy(*(a if np.isfinite(a) or a < 0 else b for a, b in pairs))


def apart(first: Occupancy, second: Occupancy) -> Any:
    """Return the time between two occupancies, s; 0 if they overlap.

    Args:
        first: Times of one vehicle in the area, s; numbers or arrays.
        second: Times of the second vehicle, of the same shape.

    Returns:
        An array of that shape. Infinity if one never arrives, or both had left before they came
        into view.
    """
    with np.errstate(invalid="ignore"):
        gaps = second.enters - first.leaves, first.enters - second.leaves
    never = np.isposinf(first.enters) | np.isposinf(second.enters) | np.isnan(gaps).any(axis=0)
    return np.where(never, np.inf, np.maximum(np.maximum(*gaps), 0.0))


_SAME_DIRECTION = np.radians(45.0)
_REACH = 100.0  # m; vehicles further ahead are no leaders
_MOMENTS = 100  # moments that are compared at once, which bounds memory
_BESIDE = 5.0  # m; half of two vehicles as wide as any is (`plausible.WIDEST`), and half a metre


class Near(NamedTuple):
    """Neighbour of a vehicle on its way; by default there is none."""

    track: int = -1  # number of the track; -1 if there is none
    gap: float = float("inf")  # between the bumpers, m; infinite if there is none
    speed: float = 0.0  # of the neighbour along the way, m/s; 0 if there is none


OfVehicles = Float64[np.ndarray, " vehicle"]


class OnWay(NamedTuple):
    """Other vehicles of one frame that are on a way."""

    track: Int64[np.ndarray, " vehicle"]  # numbers of the tracks
    along: OfVehicles  # coordinates of their middles on the way, m
    speed: OfVehicles  # along the way, m/s
    length: OfVehicles  # m

    def without(self, track: int) -> OnWay:
        """Return all vehicles but that of one track."""
        return OnWay(*(column[self.track != track] for column in self))


def on_way(scene: Scene, way: Way, frame: int, slack: float) -> OnWay:
    """Return the vehicles whose rectangles are on a way at a frame, driving as it leads.

    Args:
        scene: Recording on its road.
        way: Way of a vehicle, which itself is left out.
        frame: Frame of the recording.
        slack: Width by which vehicles are narrower than recorded, m.
    """
    tracks = scene.tracks
    rows = scene.present(frame)
    rows = rows[tracks.track[rows] != way.track]
    positions = way.line.coordinates(tracks.x[rows], tracks.y[rows])
    turned = wrapped(tracks.heading[rows] - positions.heading)
    number = tracks.track[rows]
    inside = in_the_way(way, positions.lateral, turned, tracks.width[number], slack)
    speed = scene.speed[rows] * np.cos(turned)
    chosen = number[inside].astype(np.int64)
    return OnWay(chosen, positions.along[inside], speed[inside], tracks.length[chosen])


class Ahead(NamedTuple):
    """Vehicles on a way ahead of the vehicle that drives it; a row for each vehicle and frame."""

    moment: Int64[np.ndarray, " row"]  # frames after the way's first
    track: Int64[np.ndarray, " row"]  # number of the track
    along: Float64[np.ndarray, " row"]  # coordinate of its middle on the way, m

    def holds(self, entry: float, but: int, moments: int) -> Bool[np.ndarray, " moment"]:
        """Return at which moments a vehicle is before a coordinate of the way.

        Args:
            entry: The coordinate, m.
            but: Number of a track that doesn't count.
            moments: Number of frames of the way.

        Returns:
            A value for each frame of the way, from its first.
        """
        held = np.zeros(moments, bool)
        held[self.moment[(self.along < entry) & (self.track != but)]] = True
        return held


def ahead_of(scene: Scene, way: Way, slack: float) -> Ahead:
    """Return the vehicles of `on_way` that are on the line ahead; only near ones are compared.

    Args:
        scene: Recording on its road.
        way: Way of a vehicle, which itself is left out.
        slack: Width by which vehicles are narrower than recorded, m.

    Returns:
        Rows for all frames of the way, in the order of the frames.
    """
    tracks = scene.tracks
    moments = np.arange(len(way.along))
    columns = []
    west, south, east, north = way.box
    for block in np.split(moments, moments[_MOMENTS::_MOMENTS]):
        every = [scene.present(way.first + moment) for moment in block.tolist()]
        rows = np.concatenate(every)
        moment = np.repeat(block, [len(rows_of) for rows_of in every])
        x = tracks.x[rows]
        y = tracks.y[rows]
        near = (x > west - _BESIDE) & (x < east + _BESIDE) & (y > south - _BESIDE)
        near &= (y < north + _BESIDE) & (tracks.track[rows] != way.track)
        rows = rows[near]
        moment = moment[near]
        positions = way.line.coordinates(x[near], y[near])
        number = tracks.track[rows]
        turned = wrapped(tracks.heading[rows] - positions.heading)
        inside = in_the_way(way, positions.lateral, turned, tracks.width[number], slack)
        inside &= positions.along > way.along[moment]
        columns.append((moment[inside], number[inside].astype(np.int64), positions.along[inside]))
    return Ahead(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def in_the_way(
    way: Way, lateral: OfVehicles, turned: OfVehicles, width: OfVehicles, slack: float
) -> Bool[np.ndarray, " vehicle"]:
    """Whether vehicles near a way overlap what it sweeps, and drive as it leads.

    Args:
        way: Way of a vehicle, which sweeps its width.
        lateral: Distances of the vehicles' middles from the line, m, with either sign.
        turned: Their headings relative to the line's direction, rad in [-π, π]; below 45 degrees
            they drive as it leads.
        width: Their widths as recorded, m.
        slack: Width by which all are narrower than recorded, m.
    """
    beside = np.abs(lateral) < (way.width + width) / 2 - slack
    return beside & (np.abs(turned) < _SAME_DIRECTION)


def leader(way: Way, along: float, vehicles: OnWay) -> Near:
    """Return the next vehicle on a way ahead of a follower.

    Args:
        way: Way of the follower.
        along: Coordinate of the follower's middle on it, m.
        vehicles: Vehicles on the way, of one frame.

    Returns:
        The nearest whose middle is ahead by less than 100 m; `Near()` if there is none.
    """
    return _next(way, vehicles.along - along, vehicles)


def follower(way: Way, along: float, vehicles: OnWay) -> Near:
    """Return the next vehicle on a way behind a coordinate, as `leader` does ahead.

    Args:
        way: Way of the vehicle that is followed.
        along: Coordinate of its middle on it, m.
        vehicles: Vehicles on the way, of one frame.

    Returns:
        The nearest whose middle is behind by less than 100 m; `Near()` if there is none.
    """
    return _next(way, along - vehicles.along, vehicles)


def _next(way: Way, apart: OfVehicles, vehicles: OnWay) -> Near:
    near = (apart > 0) & (apart < _REACH)
    if not near.any():
        return Near()
    index = int(np.argmin(np.where(near, apart, np.inf)))
    gap = apart[index] - (vehicles.length[index] + way.length) / 2
    return Near(int(vehicles.track[index]), float(gap), float(vehicles.speed[index]))


class InTime:
    """Ways by track, sorted by their first frames, so that look-ups cost little."""

    def __init__(self, ways: Mapping[int, Way], horizon: float = 0.0) -> None:
        self.ways = ways
        self._every = list(ways.values())
        self.horizon = horizon
        first = np.array([way.first for way in self._every], np.int64)
        self._last = np.array([way.last for way in self._every], np.int64)
        self._order = np.argsort(first, kind="stable")
        self._first = first[self._order]
        self.longest = max((len(way.along) for way in self._every), default=0)  # frames

    @cached_property
    def _boxes(self) -> Float64[np.ndarray, "2 way 4"]:
        every = self._every
        horizon = self.horizon
        boxes = [way.box for way in every], [way.box_within(horizon) for way in every]
        return np.array(boxes).reshape(2, -1, 4)

    def between(self, first: int | float, last: int | float, near: Way | None = None) -> list[Way]:
        """Return the ways that are seen between two frames, in the order of `ways`.

        Args:
            first: First frame, included; a fraction is possible.
            last: Last frame, included.
            near: Another way. With it, only ways are returned that may reach an area in common
                within the horizon; most pairs of ways end here.
        """
        begin = np.searchsorted(self._first, first - self.longest, side="left")
        end = np.searchsorted(self._first, last, side="right")
        chosen = np.sort(self._order[begin:end])
        chosen = chosen[self._last[chosen] >= first]
        if near is not None:
            of_near = np.array([near.box, near.box_within(self.horizon)])
            for box, boxes in zip(of_near, self._boxes[::-1], strict=True):
                beside = (boxes[chosen, :2] <= box[2:]) & (box[:2] <= boxes[chosen, 2:])
                chosen = chosen[beside.all(axis=1)]
        return [self._every[index] for index in chosen.tolist()]

    def earlier(self, frame: int | float) -> Iterator[Way]:
        """Yield the ways that are seen first at a frame or before it, the latest first."""
        end = int(np.searchsorted(self._first, frame, side="right"))
        for index in self._order[:end][::-1].tolist():
            yield self._every[index]
