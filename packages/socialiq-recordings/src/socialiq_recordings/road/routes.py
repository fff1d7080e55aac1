"""Map matching: a track's sequence of lanelets, and the line along it.

A track is matched to the closest of all sequences of lanelets, with costs for changes of lane and
gaps in the map (Viterbi algorithm).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64

from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanes, RoadNetwork, lanes_of
from socialiq_recordings.road.paths import Arc, Polyline, path_of, wrapped

LANE_CHANGE = 2.0  # cost of a change of lane, in m of misfit for one state
GAP = 20.0  # cost of a step to a lanelet that is not connected
OFF_THE_MAP = 3.5  # m; largest mean distance from the nearest lanelet
AHEAD = 100.0  # m; continuation of a route beyond the last state
_HOPS = 3  # most lanelets passed between two frames

VEHICLES = (RoadUser.CAR, RoadUser.TRUCK, RoadUser.BUS, RoadUser.MOTORCYCLE)
"""Road users that drive on lanelets; others are neither ego nor neighbour."""


@dataclass(frozen=True, eq=False)
class Matched:
    """Track matched to the road.

    Attributes:
        lanelets: Sequence of lanelets, continued straight on beyond the last state.
        place: Index of each state's lanelet in that sequence.
        off: Mean distance from the sequence, m.
    """

    lanelets: tuple[int, ...]
    place: Int64[np.ndarray, " state"]
    off: float


class Matcher:
    """Matcher of tracks to a road network, with the same measure for all lanelets.

    Args:
        road: The lanelets.
    """

    def __init__(self, road: RoadNetwork) -> None:
        self.numbers = np.array(list(road.lanelets), np.int64)
        self.paths = [path_of(lanelet.centre) for lanelet in road.lanelets.values()]
        self._place = {int(number): index for index, number in enumerate(self.numbers)}
        self._road = road
        self._price = self._prices()

    def path(self, number: int) -> Polyline | Arc:
        """Return a lanelet's centre line."""
        return self.paths[self._place[number]]

    def _prices(self) -> Float64[np.ndarray, "from to"]:
        count = len(self.numbers)
        follows = np.zeros((count, count), bool)
        price = np.full((count, count), GAP)
        for index, lanelet in enumerate(self._road.lanelets.values()):
            for beside in (lanelet.adjacent_left, lanelet.adjacent_right):
                if beside is not None and beside[1] and beside[0] in self._place:
                    price[index, self._place[beside[0]]] = LANE_CHANGE
            for number in lanelet.successors:
                if number in self._place:
                    follows[index, self._place[number]] = True
        reached = follows.copy()
        for _ in range(_HOPS):
            price[reached] = 0.0
            reached = reached @ follows
        np.fill_diagonal(price, 0.0)
        return price

    def misfit(
        self,
        x: Float64[np.ndarray, " state"],
        y: Float64[np.ndarray, " state"],
        heading: Float64[np.ndarray, " state"],
    ) -> tuple[Float64[np.ndarray, "state lanelet"], Float64[np.ndarray, "state lanelet"]]:
        """Return the misfit of each lanelet for each state, in metres and radians.

        The measure is that of the simulator (`core.geometry.closest_lane`).

        Returns:
            The sum, and its part in metres.
        """
        metres = np.empty((len(x), len(self.paths)))
        radians = np.empty_like(metres)
        for index, path in enumerate(self.paths):
            position = path.coordinates(x, y)
            beyond = np.maximum(position.along - path.length, 0) + np.maximum(-position.along, 0)
            metres[:, index] = abs(position.lateral) + beyond
            radians[:, index] = abs(wrapped(heading - position.heading))
        return metres + radians, metres

    def match(self, tracks: Tracks, number: int) -> Matched:
        """Find the lanelets of one track."""
        rows = slice(*tracks.starts[number : number + 2])
        misfit, metres = self.misfit(tracks.x[rows], tracks.y[rows], tracks.heading[rows])
        chosen = self._cheapest(misfit)
        sequence, index = [int(chosen[0])], np.zeros(len(chosen), np.int64)
        for state in range(1, len(chosen)):
            if chosen[state] != sequence[-1]:
                sequence += self._between(sequence[-1], int(chosen[state]))
            index[state] = len(sequence) - 1
        lanelets = [int(self.numbers[number_of_lanelet]) for number_of_lanelet in sequence]
        off = float(metres[np.arange(len(chosen)), chosen].mean())
        return Matched(tuple(lanelets + self._onwards(lanelets[-1])), index, off)

    def _cheapest(self, misfit: Float64[np.ndarray, "state lanelet"]) -> Int64[np.ndarray, " s"]:
        total = misfit[0].copy()
        came_from = np.empty(misfit.shape, np.int64)
        lanelets = np.arange(misfit.shape[1])
        for state in range(1, len(misfit)):
            by_way = total[:, None] + self._price
            came_from[state] = np.argmin(by_way, axis=0)
            total = by_way[came_from[state], lanelets] + misfit[state]
        chosen = np.empty(len(misfit), np.int64)
        chosen[-1] = np.argmin(total)
        for state in range(len(misfit) - 1, 0, -1):
            chosen[state - 1] = came_from[state, chosen[state]]
        return chosen

    def _between(self, one: int, other: int) -> list[int]:
        """Return the lanelets passed without a state, and the lanelet reached."""
        ways = [[one]]
        for _ in range(_HOPS):
            longer = []
            for way in ways:
                for number in self._road.lanelets[int(self.numbers[way[-1]])].successors:
                    if number in self._place:
                        longer.append([*way, self._place[number]])
            for way in longer:
                if way[-1] == other:
                    return way[1:]
            ways = longer
        return [other]

    def _onwards(self, number: int) -> list[int]:
        """Return the lanelets that follow, always the straightest successor."""
        way, length = [number], 0.0
        while length < AHEAD:
            following = [candidate for candidate in self._next(way[-1]) if candidate not in way]
            if not following:
                break
            way.append(min(following, key=lambda candidate: _bend(self._road, candidate)))
            length += self.path(way[-1]).length
        return way[1:]

    def section(self, lanelets: list[int], least: float = 0.0) -> Polyline | Arc | None:
        """Return the line along consecutive lanelets, without parallel lanes.

        Args:
            lanelets: Part of a sequence.
            least: m; a shorter line is continued beyond the sequence, if the road continues.
        """
        kept: list[int] = []
        for number in lanelets:
            if not kept or number in self._next(kept[-1]):
                kept.append(number)
        if not kept:
            return None
        length = sum(self.path(number).length for number in kept)
        while length < least:
            onwards = [n for n in self._next(kept[-1]) if n not in kept]
            if not onwards:
                break
            kept.append(min(onwards, key=lambda number: _bend(self._road, number)))
            length += self.path(kept[-1]).length
        if len(kept) == 1:
            return self.path(kept[0])
        points = [self._road.lanelets[n].centre for n in kept]
        return path_of(np.concatenate(points))

    def _next(self, number: int) -> list[int]:
        successors = self._road.lanelets[number].successors
        return [successor for successor in successors if successor in self._place]


def _bend(road: RoadNetwork, number: int) -> float:
    steps = np.diff(road.lanelets[number].centre, axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    return float(abs(wrapped(heading[-1:] - heading[:1]))[0])


class Scene:
    """Recording with its conflicts and routes.

    Args:
        recording: Tracks and road.

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
        tracks = recording.tracks
        self.tracks = tracks
        self.lanes: Lanes = lanes_of(recording.road)
        self.matcher = Matcher(recording.road)
        kinds = [int(kind) for kind in VEHICLES]
        self.vehicles = np.flatnonzero(np.isin(tracks.road_user, kinds))
        self.speed = tracks.vx * np.cos(tracks.heading) + tracks.vy * np.sin(tracks.heading)
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
