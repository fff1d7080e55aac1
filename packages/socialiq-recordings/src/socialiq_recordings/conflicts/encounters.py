"""Conflict areas of driven ways, and the conflicts of ordered pairs of road users.

The swept area of a way is what the vehicle's width covers along it. Shapely (extra `maps`)
intersects two of them. Two vehicles are in conflict if their ways cross or merge and they would be
in the area close in time. A conflict has two rows, one for each vehicle as the ego. Road users who
follow no lanelets, on foot or a bicycle or where there are none, meet where swept areas do.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from socialiq.errors import UserError
from socialiq.physics import wrapped
from socialiq_recordings.conflicts import ways as motion
from socialiq_recordings.conflicts.ways import InTime, Occupancy, Way
from socialiq_recordings.recording import PEOPLE, RoadUser
from socialiq_recordings.road.network import Conflict, Lanes, shapely
from socialiq_recordings.road.paths import Polyline
from socialiq_recordings.road.routes import OFF_THE_MAP, Scene


@dataclass(frozen=True)
class ConflictConfig:
    """Options of conflicts."""

    # Further apart in an area is no conflict: the threshold of PET in FHWA-HRT-08-051 (2008).
    near: float = 5.0  # s
    horizon: float = 10.0  # s ahead in which both must arrive at their present speeds
    queued: bool = False  # whether those behind others of their lane are in conflict, too
    slack: float = 0.3  # m by which vehicles are narrower than recorded, since boxes from video err

    def __post_init__(self) -> None:
        for name in ("near", "horizon", "slack"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise UserError(f"{name} must be a number of at least 0, got {value}")


SAME_WAY = np.radians(20.0)
"""Ways whose directions differ by less at the end of their common area go on together."""

CROSSING = 30.0
"""Degrees; vehicles at a smaller angle follow each other or drive side by side and don't cross
(Gettman et al. 2008, FHWA-HRT-08-051: below 30 degrees a conflict is of the kind rear end)."""

HEAD_ON = 150.0
"""Degrees; two who follow no lanelets and whose directions differ by more pass each other on one
line, and do not cross. On lanelets they turn across oncoming traffic."""

NEAR = 50.0  # m before a light from which a driver brakes for it: from 14 m/s at 2 m/s²

_LEAST = 0.1  # m²; smaller areas are errors of the lines
_SEPARATE = 2.5  # m; vehicles that merge came from further beside each other than this
_JOINED = 1.0  # m; and get closer than this
_BEFORE = 50.0  # m before a merging line in which they were apart
_START = 1.0  # m after a line's start within which an area begins there


@dataclass(frozen=True, eq=False)
class Area:
    """Conflict area of two ways; where they merge, one vehicle follows the second from then on."""

    kind: Conflict  # crossing or merging
    # coordinates at which the vehicles' swept areas begin to be in it, m
    entry: tuple[float, float]
    exit: tuple[float, float]  # at which they end; the entry where the ways merge
    angle: float  # difference of the directions in it, degrees in [0, 180]
    x: float  # its middle, m to the east
    y: float  # its middle, m to the north
    outline: Float64[np.ndarray, "corner 2"]  # its corners, m

    @property
    def is_conflict(self) -> bool:
        """Whether vehicles merge or cross in it, and don't merely drive side by side."""
        return self.kind != Conflict.CROSSING or self.angle >= CROSSING

    def swapped(self) -> Area:
        """Return the area with the two vehicles exchanged."""
        return replace(self, entry=self.entry[::-1], exit=self.exit[::-1])


def area_of(
    first: Way, second: Way, first_swept: Any, second_swept: Any, lanes: Lanes
) -> Area | None:
    """Return the first area in which two ways cross or merge; None if there is none.

    The map must agree: two lanelets of the routes are in conflict, or both routes enter one lanelet
    from different lanelets, as in a change of lane. An area that begins where one of the lines does
    is no conflict: the vehicles follow each other, or the first is past it. If either follows no
    lanelets, the map is not consulted, and of several areas it is the one that both were in closest
    in time.

    Args:
        first: Way of the first vehicle.
        second: Way of the second vehicle.
        first_swept: Shapely's polygon that the first vehicle sweeps along its way, m.
        second_swept: Shapely's polygon that the second vehicle sweeps, m.
        lanes: Lanelets of the map, with the pairs that are in conflict.

    Returns:
        The area, with the first way's coordinates first.
    """
    on_map = bool(first.lanelets and second.lanelets)
    if on_map and all(
        lanes.against[number].isdisjoint(second.lanelets) for number in first.lanelets
    ):
        before, before_other = (
            dict(zip(way.lanelets[1:], way.lanelets, strict=False)) for way in (first, second)
        )
        common = {*first.lanelets} & {*second.lanelets}
        if all(before.get(number) == before_other.get(number) for number in common):
            return None
    if not first_swept.intersects(second_swept):
        return None
    common = first_swept.intersection(second_swept)
    areas = []
    for polygon in getattr(common, "geoms", [common]):
        if polygon.geom_type == "Polygon" and polygon.area >= _LEAST:
            area = _area(first, second, polygon)
            if area is not None:
                areas.append(area)
    if not on_map:
        areas.sort(key=lambda area: area.entry[0])
        return min(areas, key=lambda area: _apart(first, second, area), default=None)
    return min(areas, key=lambda area: area.entry[0]) if areas else None


def _apart(first: Way, second: Way, area: Area) -> float:
    sides = zip((first, second), area.entry, area.exit, strict=True)
    return float(motion.apart(*(motion.recorded(*side) for side in sides)))


def _area(first: Way, second: Way, polygon: Any) -> Area | None:
    corners = np.array(polygon.exterior.coords)[:-1]
    entry = []
    end = []
    for way in (first, second):
        along = way.line.coordinates(corners[:, 0], corners[:, 1]).along
        entry.append(float(along.min()))
        end.append(float(min(along.max(), way.line.length)))
        if entry[-1] <= _START:
            return None
    middle = [(low + high) / 2 for low, high in zip(entry, end, strict=True)]
    merging = _between(first.line, end[0], second.line, end[1]) < SAME_WAY
    if merging:
        # Vehicles whose swept areas join come from different lanes to one, and neither has passed
        # the line where their ways join at its first state. Ways side by side, and those of
        # vehicles in one lane, touch by errors of positions.
        sides = zip((first, second), entry, strict=True)
        if any(way.along[0] + way.length / 2 > at for way, at in sides):
            return None
        before = _beside(first.line, second.line, max(entry[0] - _BEFORE, 0.0), entry[0])
        after = _beside(first.line, second.line, entry[0], end[0])
        if before.max() < _SEPARATE or after.min() >= _JOINED:
            return None
    # Ways that join are compared where they meet, ways that cross in the middle.
    at = entry if merging else middle
    angle = float(np.degrees(_between(first.line, at[0], second.line, at[1])))
    kind = Conflict.MERGING if merging else Conflict.CROSSING
    begin = entry[0], entry[1]
    place = float(polygon.centroid.x), float(polygon.centroid.y)
    return Area(kind, begin, begin if merging else (end[0], end[1]), angle, *place, corners)


def _beside(
    line: Polyline, second: Polyline, low: float, high: float
) -> Float64[np.ndarray, " point"]:
    """Return distances between two lines along a part of the first, m."""
    points = line.points_at(np.append(np.arange(low, high, 1.0), high))[0]
    return np.abs(second.coordinates(points[:, 0], points[:, 1]).lateral)


def _between(first: Polyline, at: float, second: Polyline, second_at: float) -> float:
    """Return the angle between two lines, rad."""
    headings = [
        line.points_at(np.array([along]))[1] for line, along in ((first, at), (second, second_at))
    ]
    return float(abs(wrapped(headings[0] - headings[1]))[0])


def held(scene: Scene, way: Way, frame: int) -> bool:
    """Whether the next light on a vehicle's route is near, ahead of its front, and closed.

    A light is at the end of its lanelet. Lights without states in the file hold no driver.

    Args:
        scene: Recording on its road, with the lights of its lanelets.
        way: Way of the vehicle.
        frame: Frame of the recording at which the vehicle is present.

    Returns:
        False also for a vehicle that follows no lanelets.
    """
    if not way.lanelets:
        return False
    matched = scene.matched(way.track)
    lanelets = scene.lanes.road.lanelets
    front = way.state(frame)[0] + way.length / 2
    for number in matched.lanelets[int(matched.place[frame - way.first]) :]:
        cycle = lanelets[number].cycle
        end = lanelets[number].centre[-1:]
        if cycle is None:
            continue
        ahead = float(way.line.coordinates(end[:, 0], end[:, 1]).along[0]) - front
        if ahead >= 0.0:
            return ahead <= NEAR and cycle.closed(frame)
    return False


@dataclass(frozen=True, eq=False)
class Meeting:
    """Conflict of an ordered pair."""

    ego: Way  # way of the vehicle whose conflict it is
    other: Way  # way of the other vehicle
    area: Area  # their conflict area, the ego first
    complete: bool  # whether the times that PET needs were recorded
    frames: np.ndarray  # frames at which both are present and neither has left the area

    @property
    def is_head_on(self) -> bool:
        """Whether two come towards each other in shared space, so that neither goes first."""
        in_lanes = self.ego.lanelets and self.other.lanelets
        crosses = self.area.kind == Conflict.CROSSING
        return bool(crosses and self.area.angle > HEAD_ON and not in_lanes)

    @cached_property
    def times(self) -> tuple[Float64[np.ndarray, "frame 2"], Float64[np.ndarray, "frame 2"]]:
        """Times of the ego and of its partner in the area at their speeds of each of the frames."""
        sides = zip((self.ego, self.other), self.area.entry, self.area.exit, strict=True)
        ego_times, other_times = (motion.projections(*side, self.frames) for side in sides)
        return ego_times, other_times

    @cached_property
    def ego_times(self) -> Occupancy:
        """The ego's times in the area, recorded or else projected."""
        return motion.expected(self.ego, self.area.entry[0], self.area.exit[0])

    @cached_property
    def other_times(self) -> Occupancy:
        """The other's times."""
        return motion.expected(self.other, self.area.entry[1], self.area.exit[1])

    @property
    def ego_first(self) -> bool | None:
        """Whether the ego enters the area first; None if neither will arrive."""
        if np.isinf(self.ego_times.enters) and np.isinf(self.other_times.enters):
            return None
        return bool(self.ego_times.enters <= self.other_times.enters)

    def swapped(self) -> Meeting:
        """Return the conflict with the roles of both vehicles exchanged."""
        swapped = Meeting(self.other, self.ego, self.area.swapped(), self.complete, self.frames)
        swapped.__dict__["times"] = self.times[::-1]
        return swapped


class Encounters:
    """Ways, by track, and conflict areas of a recording's vehicles on the road.

    With `everybody`, also of the road users who follow no lanelets.
    """

    def __init__(
        self, scene: Scene, config: ConflictConfig | None = None, everybody: bool = False
    ) -> None:
        self.scene = scene
        self.config = config or ConflictConfig()
        drivers = [n for n in scene.vehicles.tolist() if n not in scene.free]
        met = [track for track in drivers if scene.matched(track).off <= OFF_THE_MAP]
        met += sorted(scene.free) if everybody else []
        self.ways: dict[int, Way] = {track: motion.way_of(scene, track) for track in met}
        self._swept: dict[int, Any] = {}
        self._ahead: dict[int, motion.Ahead] = {}
        self._areas: dict[tuple[int, int], Area | None] = {}

    @cached_property
    def in_time(self) -> InTime:
        """The ways by the time at which their vehicles are seen."""
        return InTime(self.ways, self.config.horizon)

    def area(self, first: int, second: int) -> Area | None:
        """Return the conflict area of two tracks; None if there is none.

        Areas are kept, so that each pair is intersected once.

        Args:
            first: Number of the track whose coordinates come first.
            second: Number of the second track.
        """
        pair = (min(first, second), max(first, second))
        if pair not in self._areas:
            ways = self.ways[pair[0]], self.ways[pair[1]]
            (west, south, east, north), (left, low, right, high) = (way.box for way in ways)
            if west > right or left > east or south > high or low > north:
                return None  # most pairs end here
            users = self.scene.tracks.road_user
            for way in (way for way in ways if way.track not in self._swept):
                nominal = users[way.track] in PEOPLE  # no slack off sizes that are typical
                width = max(way.width - (0.0 if nominal else self.config.slack), 0.1)
                line = shapely().linestrings(way.line.points)
                swept = line.buffer(width / 2, cap_style="flat", join_style="round")
                self._swept[way.track] = swept
            both = self._swept[pair[0]], self._swept[pair[1]]
            self._areas[pair] = area_of(*ways, *both, self.scene.lanes)
        area = self._areas[pair]
        return area if area is None or first == pair[0] else area.swapped()

    def moved(self, scene: Scene, ways: Mapping[int, Way]) -> Encounters:
        """Return the encounters of other motion along the same ways; the areas stay.

        Args:
            scene: The motion on the same road; its tracks are numbered newly.
            ways: By the track's number here, the way in that scene, with its new number. Tracks
                that are not in that scene are missing.

        Returns:
            A copy with these ways. This object stays as it is.
        """
        copied = copy.copy(self)
        copied.__dict__.pop("in_time", None)
        copied.scene = scene
        copied.ways = {way.track: way for way in ways.values()}
        number = {track: way.track for track, way in ways.items()}
        copied._swept = {number[t]: value for t, value in self._swept.items() if t in number}
        copied._areas = {
            (number[a], number[b]): area
            for (a, b), area in self._areas.items()
            if a in number and b in number
        }
        copied._ahead = {}
        return copied

    def meeting(self, ego: int, partner: int) -> Meeting | None:
        """Return the conflict of an ordered pair of tracks; None if there is none.

        Either both passed the area within `near` s and were in view together before the second
        arrived, or at one moment before either had left they would at their speeds. Both are the
        first of their lanes then: a vehicle that queues behind others meets them, not the crossing
        traffic.

        Args:
            ego: Number of the track whose conflict it is.
            partner: Number of the second vehicle's track.
        """
        ways = self.ways[ego], self.ways[partner]
        together = motion.frames_together(*ways)
        area = self.area(ego, partner) if len(together) else None
        if area is None:
            return None
        sides = list(zip(ways, area.entry, area.exit, strict=True))
        times = [motion.recorded(*side) for side in sides]
        dt = ways[0].dt
        frames = together[together * dt < min(occupancy.leaves for occupancy in times)]
        late = 0 if times[0] > times[1] else 1
        first = times[1 - late]
        second = times[late]
        complete = bool(np.isfinite(first.leaves) and np.isfinite(second.enters))
        in_view = complete and together[0] * dt < second.enters
        met = in_view and second.enters - first.leaves <= self.config.near
        if met:
            # No third vehicle enters between them, and no red light holds the second.
            way = ways[late]
            frame = int(np.clip(np.ceil(first.leaves / dt), way.first, way.last))
            met = self.first_in_line(way, area.entry[late], frame, ways[1 - late].track)
            met = met and not held(self.scene, way, frame)
        meeting = Meeting(*ways, area, complete, frames)
        return meeting if met or self._on_course(meeting) else None

    def _on_course(self, meeting: Meeting) -> bool:
        """Whether two vehicles would once be in the area close in time, and are first in line."""
        ego = meeting.ego
        partner = meeting.other
        frames = meeting.frames
        first, second = (Occupancy(*times.T) for times in meeting.times)
        soon = np.maximum(first.enters, second.enters) <= frames * ego.dt + self.config.horizon
        close = soon & (motion.apart(first, second) <= self.config.near)
        if close.any() and not self.config.queued:
            sides = zip((ego, partner), meeting.area.entry, (partner, ego), strict=True)
            for way, entry, ignored in sides:
                close &= ~self._held_up(way, entry, ignored.track)[frames - way.first]
        return any(not self.held(ego, partner, frame) for frame in frames[close].tolist())

    def _held_up(self, way: Way, entry: float, but: int) -> Bool[np.ndarray, " moment"]:
        if not way.lanelets:  # who follows no lane queues behind no one
            return np.zeros(len(way.along), bool)
        if way.track not in self._ahead:
            self._ahead[way.track] = motion.ahead_of(self.scene, way, self.config.slack)
        return self._ahead[way.track].holds(entry, but, len(way.along))

    def held(self, first: Way, second: Way, frame: int) -> bool:
        """Whether a red light holds either of two vehicles at a frame.

        Args:
            first: Way of one vehicle.
            second: Way of the second vehicle.
            frame: Frame of the recording at which both are present.
        """
        return held(self.scene, first, frame) or held(self.scene, second, frame)

    def first_in_line(self, way: Way, entry: float, frame: int, but: int) -> bool:
        """Whether no other vehicle is on a way between its vehicle and the entry of an area.

        It always holds if vehicles that queue are in conflict, too (`ConflictConfig.queued`).

        Args:
            way: Way of the vehicle.
            entry: Coordinate on the way at which the area begins, m.
            frame: Frame of the recording at which the vehicle is present.
            but: Number of the track that doesn't count: the second vehicle of the conflict.
        """
        return self.config.queued or not self._held_up(way, entry, but)[frame - way.first]

    def meetings(self) -> list[Meeting]:
        """Return all conflicts, two for each pair, in the order of the tracks.

        Two pedestrians are in none.
        """
        every: dict[tuple[int, int], Meeting | None] = {}
        walks = self.scene.tracks.road_user == RoadUser.PEDESTRIAN
        for ego, ego_way in self.ways.items():
            for way in self.in_time.between(ego_way.first, ego_way.last, ego_way):
                if way.track == ego or (walks[ego] and walks[way.track]):
                    continue
                if (way.track, ego) in every:
                    meeting = every[way.track, ego]
                    every[ego, way.track] = meeting.swapped() if meeting else None
                else:
                    every[ego, way.track] = self.meeting(ego, way.track)
        return [meeting for meeting in every.values() if meeting is not None]
