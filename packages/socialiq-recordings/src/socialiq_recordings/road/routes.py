"""Map matching: a track's sequence of lanelets.

A track is matched to the closest of all sequences of lanelets, with costs for changes of lane and
gaps in the map (Viterbi algorithm).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.physics import wrapped
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanes, RoadNetwork, lanes_of
from socialiq_recordings.road.paths import ROUNDING, Arc, Polyline, on_segments, path_of

LANE_CHANGE = 2.0  # cost of a change of lane, in m of misfit for one state
GAP = 20.0  # cost of a step to a lanelet that is not connected
OFF_THE_MAP = 3.5  # m; largest mean distance from the nearest lanelet
AHEAD = 100.0  # m; continuation of a route beyond the last state
_HOPS = 3  # most lanelets passed between two frames
_NEAR = 6.0  # m; distance to which lanelets are looked for at first
_BLOCK = 500  # states that are compared at once, which bounds memory

VEHICLES = (RoadUser.CAR, RoadUser.TRUCK, RoadUser.BUS, RoadUser.MOTORCYCLE)
"""Road users that drive on lanelets, where there are any."""
OfStates = Float64[np.ndarray, " state"]
OfPairs = Float64[np.ndarray, " pair"]
Misfits = Float64[np.ndarray, "state lanelet"]
Numbers = Int64[np.ndarray, " lanelet"]


@dataclass(frozen=True, eq=False)
class Matched:
    """Track matched to the road."""

    lanelets: tuple[int, ...]  # sequence of lanelets, continued straight on beyond the last state
    place: Int64[np.ndarray, " state"]  # index of each state's lanelet in that sequence
    off: float  # mean distance from the sequence, m


class Matcher:
    """Matcher of tracks to a road network, with the same measure for all lanelets."""

    def __init__(self, road: RoadNetwork) -> None:
        self._road = road
        self._numbers = list(road.lanelets)
        self._index = index = {number: row for row, number in enumerate(self._numbers)}
        self._paths = {number: path_of(lane.centre) for number, lane in road.lanelets.items()}
        # Lanelets to which a step costs less than a gap, each with its cost.
        self._cheap: list[dict[int, float]] = []
        for number, lanelet in road.lanelets.items():
            beside = (lanelet.adjacent_left, lanelet.adjacent_right)
            cheap = {index[at[0]]: LANE_CHANGE for at in beside if at and at[1] and at[0] in index}
            reached = {number}
            for _ in range(_HOPS):
                reached = {after for number in reached for after in self._next(number)}
                cheap |= dict.fromkeys((index[number] for number in reached), 0.0)
            self._cheap.append(cheap | {index[number]: 0.0})
        # Boxes around the paths, and the segments of all polylines in one table.
        boxes = []
        lines = []
        for path in self._paths.values():
            if isinstance(path, Arc):
                middle = np.array([path.x, path.y])
                boxes.append((middle - path.radius, middle + path.radius))
                lines.append(np.zeros((8, 0)))
            else:
                boxes.append((path.points.min(axis=0), path.points.max(axis=0)))
                lines.append(path.segments)
        self._low, self._high = (np.array(edge) for edge in zip(*boxes, strict=True))
        self._segments = np.concatenate(lines, axis=1)
        self._count = np.array([line.shape[1] for line in lines])
        self._first = np.cumsum(self._count) - self._count
        self._length = np.array([path.length for path in self._paths.values()])

    def path(self, number: int) -> Polyline | Arc:
        """Return a lanelet's centre line."""
        return self._paths[number]

    def match(self, tracks: Tracks, number: int) -> Matched:
        """Find the lanelets of one track.

        The misfit of a lanelet is that of the simulator (`core.geometry.closest_lane`): m and rad.

        Args:
            tracks: Tracks of a recording.
            number: Number of the track.
        """
        rows = slice(*tracks.starts[number : number + 2])
        place = tracks.x[rows], tracks.y[rows], tracks.heading[rows]
        reach = _NEAR
        while True:
            near, metres, misfit = self._misfits(*place, reach)
            needed, chosen = self._cheapest(near, misfit)
            if needed <= reach:
                break
            reach = max(needed if np.isfinite(needed) else 0.0, 2 * reach)
        numbers = [self._numbers[index] for index in near[chosen].tolist()]
        lanelets = numbers[:1]
        places = []
        for before, after in zip(numbers[:1] + numbers, numbers, strict=False):
            lanelets += [] if after == before else self._between(before, after)
            places.append(len(lanelets) - 1)
        off = float(metres[np.arange(len(chosen)), chosen].mean())
        route = lanelets[-1:]
        length = 0.0
        while length < AHEAD and self._go_on(route):
            length += self.path(route[-1]).length
        return Matched((*lanelets, *route[1:]), np.array(places, np.int64), off)

    def _cheapest(
        self, near: Numbers, misfit: Misfits
    ) -> tuple[float, Int64[np.ndarray, " state"]]:
        """Return the distance to which lanelets are needed, m, and the cheapest sequence."""
        if np.isinf(misfit.min(axis=1, initial=np.inf)).any():
            return np.inf, np.zeros(len(misfit), np.int64)  # further ones are needed
        at = {index: column for column, index in enumerate(near.tolist())}
        price = np.full((len(near), len(near)), GAP)  # of a step to each lanelet, from each
        for row, index in enumerate(at):
            for after, cost in self._cheap[index].items():
                if after in at:
                    price[at[after], row] = cost
        totals = [misfit[0]]
        came_from = []
        for misfits in misfit[1:]:
            costs = price + totals[-1]
            came_from.append(costs.argmin(axis=1))
            totals.append(costs.min(axis=1) + misfits)
        chosen = [int(np.argmin(totals[-1]))]
        for before in reversed(came_from):
            chosen.append(int(before[chosen[-1]]))
        # A state dearer than the cheapest by a gap leads nowhere that a gap from there doesn't for
        # less. Nor does one that costs more than the sequence with the least of all other states.
        needed = float(np.diff(np.min(totals, axis=1), prepend=0.0).max()) + GAP
        least = misfit.min(axis=1)
        dearest = float(totals[-1].min() - least.sum() + least.max()) + ROUNDING
        return min(needed, dearest), np.array(chosen[::-1])

    def _misfits(
        self, x: OfStates, y: OfStates, heading: OfStates, reach: float
    ) -> tuple[Numbers, Misfits, Misfits]:
        """Return lanelets, distances from them, m, and misfits; infinite beyond `reach`, m."""
        reach += ROUNDING
        low, high = (np.array([edge(x), edge(y)]) for edge in (np.min, np.max))
        apart = np.maximum(np.maximum(self._low - high, low - self._high), 0.0)
        near = np.flatnonzero(np.hypot(*apart.T) <= reach)
        metres, misfit = (np.full((len(x), len(near)), np.inf) for _ in range(2))
        for begin in range(0, len(x), _BLOCK):
            points = np.stack([x, y], axis=1)[begin : begin + _BLOCK, None]
            apart = np.maximum(np.maximum(self._low[near] - points, points - self._high[near]), 0.0)
            state, column = np.nonzero(np.hypot(apart[..., 0], apart[..., 1]) <= reach)
            state += begin
            distance, direction = self._away(x[state], y[state], near[column])
            metres[state, column] = distance
            misfit[state, column] = distance + np.abs(wrapped(heading[state] - direction))
        return near, metres, misfit

    def nearest(self, point: Float64[np.ndarray, "1 2"], lanelets: Sequence[int]) -> int:
        """Return the number of the lanelet that is nearest to a place; of equals the first.

        Args:
            point: The place, m, as one row.
            lanelets: Numbers of the lanelets that are compared.
        """
        index = np.array([self._index[number] for number in lanelets])
        x, y = np.repeat(point.T, len(index), axis=1)
        return lanelets[int(self._away(x, y, index)[0].argmin())]

    def _away(
        self, x: OfPairs, y: OfPairs, lanelet: Int64[np.ndarray, " pair"]
    ) -> tuple[OfPairs, OfPairs]:
        """Return distances from lanelets, m, and their headings, rad."""
        result = np.empty((3, len(x)))
        count = self._count[lanelet]
        for index in np.unique(lanelet[count == 0]).tolist():
            of_arc = lanelet == index
            along, lateral, heading = self._paths[self._numbers[index]].coordinates(
                x[of_arc], y[of_arc]
            )
            result[:, of_arc] = np.abs(lateral), along, heading
        pairs = np.flatnonzero(count)
        if len(pairs):
            count = count[pairs]
            begin = self._first[lanelet[pairs]]
            first = np.cumsum(count) - count
            number = np.arange(count.sum()) + np.repeat(begin - first, count)
            pair = np.repeat(pairs, count)
            inside, _, distance = on_segments(x[pair], y[pair], *self._segments[:6, number])
            least = np.minimum.reduceat(distance, first)
            nearest = np.flatnonzero(distance == np.repeat(least, count))
            nearest = nearest[np.searchsorted(nearest, first)]
            heading, start = self._segments[6:, number[nearest]]
            result[:, pairs] = least, start + inside[nearest], heading
        distance, along, heading = result
        length = self._length[lanelet]
        return distance + np.maximum(along - length, 0) + np.maximum(-along, 0), heading

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

        Args:
            lanelets: Numbers of the lanelets. One that does not follow the last one used is
                skipped.
            least: Length up to which the line is continued beyond them, m, if the road continues.

        Returns:
            None without a lanelet.
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
    """Recording with its conflicts and routes; `UserError` without Shapely."""

    def __init__(self, recording: Recording) -> None:
        self.tracks = tracks = recording.tracks
        self.lanes: Lanes = lanes_of(recording.road)
        self.vehicles = np.flatnonzero(np.isin(tracks.road_user, [int(kind) for kind in VEHICLES]))
        self.speed = tracks.along_and_across()[0]  # m/s, by state
        self._starts = tracks.starts
        self._matched: dict[int, Matched] = {}

    @cached_property
    def matcher(self) -> Matcher:
        """Matcher of tracks to the lanelets, of which at least one is needed."""
        return Matcher(self.lanes.road)

    @cached_property
    def free(self) -> frozenset[int]:
        """Tracks that follow no lanelets: pedestrians, bicycles; all where the map has none."""
        drivers = self.vehicles.tolist() if self.lanes.road.lanelets else ()
        return frozenset(range(self.tracks.n_tracks)).difference(drivers)

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
        return dict(zip(frames.tolist(), np.split(order, first)[1:], strict=True))

    def present(self, frame: int) -> Int64[np.ndarray, " row"]:
        """Return the rows of the vehicles of one frame, in the order of their tracks."""
        return self._by_frame.get(int(frame), np.zeros(0, np.int64))
