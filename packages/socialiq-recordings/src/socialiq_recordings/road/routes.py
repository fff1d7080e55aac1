"""Map matching: a track's sequence of lanelets, and lines with coordinates along and across.

A track is matched to the closest of all sequences of lanelets, with costs for changes of lane and
gaps in the map (Viterbi algorithm). A point before a line's start or behind its end is measured
along the line's straight extension, on an arc along the circle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.physics import wrapped
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanes, RoadNetwork, lanes_of


class Coordinates(NamedTuple):
    """Coordinates of points relative to a line."""

    along: Float64[np.ndarray, " point"]  # distance from the line's start, m; negative before it
    lateral: Float64[np.ndarray, " point"]  # distance to the left of the line, m
    heading: Float64[np.ndarray, " point"]  # direction of the line there, rad


@dataclass(frozen=True, eq=False)
class Polyline:
    """Polyline through at least two points, with different neighbours."""

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
        lengths = self._lengths
        unit = self.steps / lengths[:, None]
        dx, dy = x[:, None] - self.points[:-1, 0], y[:, None] - self.points[:-1, 1]
        along = dx * unit[:, 0] + dy * unit[:, 1]
        left = dy * unit[:, 0] - dx * unit[:, 1]
        low, high = np.zeros(len(lengths)), lengths.copy()
        low[0], high[-1] = -np.inf, np.inf
        inside = np.clip(along, low, high)
        distance = np.hypot(along - inside, left)
        piece = np.argmin(distance, axis=1)
        rows = np.arange(len(x))
        lateral = np.copysign(distance, left)[rows, piece]
        heading = np.arctan2(unit[:, 1], unit[:, 0])[piece]
        return Coordinates(self.starts[piece] + inside[rows, piece], lateral, heading)

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
    """Arc of a circle."""

    x: float  # centre, m
    y: float  # centre, m
    radius: float  # m
    phase: float  # angle at its start, rad
    sense: float  # 1 counter-clockwise, -1 clockwise
    length: float  # m

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


ARC_TOLERANCE = 1e-6  # m; points this close to a circle are an arc
_LEAST_POINTS = 8  # of an arc: three points are always on a circle
_LARGEST_RADIUS = 1000.0  # m; flatter lines are polylines


def path_of(points: Float64[np.ndarray, "point 2"]) -> Polyline | Arc:
    """Return the line through some points: an arc if they are on a circle, else a polyline."""
    points = points[np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 0])]
    polyline = Polyline(points)
    if len(points) < _LEAST_POINTS:
        return polyline
    first, middle, last = points[0], points[len(points) // 2], points[-1]
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


LANE_CHANGE = 2.0  # cost of a change of lane, in m of misfit for one state
GAP = 20.0  # cost of a step to a lanelet that is not connected
OFF_THE_MAP = 3.5  # m; largest mean distance from the nearest lanelet
AHEAD = 100.0  # m; continuation of a route beyond the last state
_HOPS = 3  # most lanelets passed between two frames

VEHICLES = (RoadUser.CAR, RoadUser.TRUCK, RoadUser.BUS, RoadUser.MOTORCYCLE)
"""Road users that drive on lanelets; others are neither ego nor neighbour."""


@dataclass(frozen=True, eq=False)
class Matched:
    """Track matched to the road."""

    lanelets: tuple[int, ...]  # sequence of lanelets, continued straight on beyond the last state
    place: Int64[np.ndarray, " state"]  # index of each state's lanelet in that sequence
    off: float  # mean distance from the sequence, m


class Matcher:
    """Matcher of tracks to a road network, with the same measure for all lanelets."""

    def __init__(self, road: RoadNetwork) -> None:
        self._road, self._numbers = road, list(road.lanelets)
        self._paths = {number: path_of(lane.centre) for number, lane in road.lanelets.items()}
        centres = [lane.centre for lane in road.lanelets.values()]
        self._low = np.array([centre.min(axis=0) for centre in centres])
        self._high = np.array([centre.max(axis=0) for centre in centres])
        # Cost of a step from each lanelet to each.
        index = {number: row for row, number in enumerate(self._numbers)}
        follows = np.zeros((len(index), len(index)), bool)
        self._price = np.full(follows.shape, GAP)
        for number, lanelet in road.lanelets.items():
            for beside in (lanelet.adjacent_left, lanelet.adjacent_right):
                if beside is not None and beside[1] and beside[0] in index:
                    self._price[index[number], index[beside[0]]] = LANE_CHANGE
            for successor in self._next(number):
                follows[index[number], index[successor]] = True
        reached = follows.copy()
        for _ in range(_HOPS):
            self._price[reached] = 0.0
            reached = reached @ follows
        np.fill_diagonal(self._price, 0.0)

    def path(self, number: int) -> Polyline | Arc:
        """Return a lanelet's centre line."""
        return self._paths[number]

    def match(self, tracks: Tracks, number: int) -> Matched:
        """Find the lanelets of one track.

        The misfit of a lanelet is that of the simulator (`core.geometry.closest_lane`): m and rad.
        """
        rows = slice(*tracks.starts[number : number + 2])
        count = int(rows.stop - rows.start)
        near, metres, misfit = self._misfits(tracks, rows)
        numbers, price = [self._numbers[index] for index in near], self._price[np.ix_(near, near)]
        # The cheapest sequence, forwards and then back.
        total, came_from = misfit[0].copy(), np.empty(misfit.shape, np.int64)
        for state in range(1, count):
            # A state dearer than the cheapest by a gap leads nowhere that a gap from there
            # doesn't for less.
            few = np.flatnonzero(total <= total.min() + GAP)
            costs = total[few, None] + price[few]
            cheapest = np.argmin(costs, axis=0)
            came_from[state] = few[cheapest]
            total = costs[cheapest, np.arange(len(total))] + misfit[state]
        chosen = np.empty(count, np.int64)
        chosen[-1] = np.argmin(total)
        for state in range(count - 1, 0, -1):
            chosen[state - 1] = came_from[state, chosen[state]]
        lanelets, places = [numbers[chosen[0]]], np.zeros(count, np.int64)
        for state in range(1, count):
            if numbers[chosen[state]] != lanelets[-1]:
                lanelets += self._between(lanelets[-1], numbers[chosen[state]])
            places[state] = len(lanelets) - 1
        off = float(metres[np.arange(count), chosen].mean())
        route, length = lanelets[-1:], 0.0
        while length < AHEAD and self._go_on(route):
            length += self.path(route[-1]).length
        return Matched((*lanelets, *route[1:]), places, off)

    def _misfits(
        self, tracks: Tracks, rows: slice
    ) -> tuple[
        Int64[np.ndarray, " lanelet"],
        Float64[np.ndarray, "state lanelet"],
        Float64[np.ndarray, "state lanelet"],
    ]:
        """Return lanelets, the distances of states from them, m, and the misfits, m and rad.

        A lanelet so far from the whole track that a gap to a nearer one and back costs less is in
        no cheapest sequence: it is not among them.
        """
        x, y, heading = tracks.x[rows], tracks.y[rows], tracks.heading[rows]
        low, high = np.array([[x.min(), y.min()], [x.max(), y.max()]])
        apart = np.hypot(*np.maximum(np.maximum(self._low - high, low - self._high), 0.0).T)
        reach = max(2 * GAP, float(apart.min()))
        while True:
            near, columns = np.flatnonzero(apart <= reach), []
            for index in near.tolist():
                path = self._paths[self._numbers[index]]
                position = path.coordinates(x, y)
                beyond = np.maximum(position.along - path.length, 0)
                beyond = beyond + np.maximum(-position.along, 0)
                metres = abs(position.lateral) + beyond
                columns.append((metres, metres + abs(wrapped(heading - position.heading))))
            metres, misfit = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
            needed = float(misfit.min(axis=1).max()) + 2 * GAP
            if needed <= reach or len(near) == len(apart):
                return near, metres, misfit
            reach = needed

    def _between(self, lanelet: int, goal: int) -> list[int]:
        """Return the lanelets passed without a state, and the lanelet reached."""
        ways = [[lanelet]]
        for _ in range(_HOPS):
            ways = [[*way, number] for way in ways for number in self._next(way[-1])]
            for way in ways:
                if way[-1] == goal:
                    return way[1:]
        return [goal]

    def _go_on(self, route: list[int]) -> bool:
        """Append the straightest lanelet that follows, if there is a new one."""

        def bend(number: int) -> float:
            steps = np.diff(self._road.lanelets[number].centre, axis=0)
            heading = np.arctan2(steps[:, 1], steps[:, 0])
            return float(abs(wrapped(heading[-1:] - heading[:1]))[0])

        onwards = [number for number in self._next(route[-1]) if number not in route]
        route += sorted(onwards, key=bend)[:1]
        return bool(onwards)

    def section(self, lanelets: list[int], least: float = 0.0) -> Polyline | Arc | None:
        """Return the line along consecutive lanelets, without parallel lanes.

        A line shorter than `least`, m, is continued beyond them, if the road continues.
        """
        route: list[int] = []
        for number in lanelets:
            if not route or number in self._next(route[-1]):
                route.append(number)
        if not route:
            return None
        length = sum(self.path(number).length for number in route)
        while length < least and self._go_on(route):
            length += self.path(route[-1]).length
        if len(route) == 1:
            return self.path(route[0])
        return path_of(np.concatenate([self._road.lanelets[number].centre for number in route]))

    def _next(self, number: int) -> list[int]:
        successors = self._road.lanelets[number].successors
        return [successor for successor in successors if successor in self._road.lanelets]


class Scene:
    """Recording with its conflicts and routes.

    Attributes:
        tracks: Tracks of the recording.
        lanes: Road with conflicts.
        matcher: Matcher of that road.
        vehicles: Numbers of the tracks that are vehicles.
        speed: Speed along the heading, m/s, by state.

    Raises:
        UserError: If there is no road network, or Shapely is not installed.
    """

    def __init__(self, recording: Recording) -> None:
        self.tracks = tracks = recording.tracks
        self.lanes: Lanes = lanes_of(recording.road)
        self.matcher = Matcher(recording.road)
        self.vehicles = np.flatnonzero(np.isin(tracks.road_user, [int(kind) for kind in VEHICLES]))
        self.speed = tracks.along_and_across()[0]
        self._starts = tracks.starts
        self._matched: dict[int, Matched] = {}

    def rows(self, track: int) -> slice:
        """Return the rows of a track."""
        return slice(int(self._starts[track]), int(self._starts[track + 1]))

    def matched(self, track: int) -> Matched:
        """Return a track's lanelets."""
        if track not in self._matched:
            self._matched[track] = self.matcher.match(self.tracks, track)
        return self._matched[track]

    @cached_property
    def _by_frame(self) -> dict[int, Int64[np.ndarray, " row"]]:
        driving = np.flatnonzero(np.isin(self.tracks.track, self.vehicles))
        order = driving[np.argsort(self.tracks.frame[driving], kind="stable")]
        frames, first = np.unique(self.tracks.frame[order], return_index=True)
        return dict(zip(frames.tolist(), np.split(order, first[1:]), strict=True))

    def present(self, frame: int) -> Int64[np.ndarray, " row"]:
        """Return the rows of the vehicles of one frame, in the order of their tracks."""
        return self._by_frame.get(int(frame), np.zeros(0, np.int64))
