"""Map matching: a track's sequence of lanelets, and its way over a junction.

A track is matched to the closest of all sequences of lanelets, with costs for changes of lane and
gaps in the map (Viterbi algorithm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from socialiq_recordings.road.network import Lanes, RoadNetwork
from socialiq_recordings.road.paths import Path, path_of, wrapped
from socialiq_recordings.tracks import Tracks

LANE_CHANGE = 2.0  # cost of a change of lane, in m of misfit for one state
GAP = 20.0  # cost of a step to a lanelet that is not connected
OFF_THE_MAP = 3.5  # m; largest mean distance from the nearest lanelet
AHEAD = 100.0  # m; continuation of a route beyond the last state
_HOPS = 3  # most lanelets passed between two frames

APPROACH, JUNCTION, EXIT = range(3)


@dataclass(frozen=True, eq=False)
class Matched:
    """Track matched to the road.

    Attributes:
        lanelets: Sequence of lanelets, continued straight on beyond the last state.
        place: Index of each state's lanelet in that sequence.
        nearest: Number of the lanelet closest to each state, regardless of the sequence.
        off: Mean distance from the sequence, m.
    """

    lanelets: tuple[int, ...]
    place: Int64[np.ndarray, " state"]
    nearest: Int64[np.ndarray, " state"]
    off: float


@dataclass(frozen=True, eq=False)
class Crossing:
    """Way of a matched track over one junction.

    Attributes:
        junction: Index in `Lanes.junctions`.
        first: Index of the junction's first lanelet in the sequence.
        last: Index of its last lanelet.
        sections: Approach, way over the junction, exit; no approach where the sequence begins
            inside the junction, no exit where it ends there.
        part: APPROACH, JUNCTION or EXIT, by state.
    """

    junction: int
    first: int
    last: int
    sections: tuple[Path | None, Path, Path | None]
    part: Int64[np.ndarray, " state"]


class Matcher:
    """Matcher of tracks to a road network, with the same measure for all lanelets.

    Args:
        road: The lanelets.
    """

    def __init__(self, road: RoadNetwork) -> None:
        self.numbers = np.array(list(road.lanelets), np.int64)
        self.paths = [path_of(lanelet.centre) for lanelet in road.lanelets.values()]
        self._place = {int(number): place for place, number in enumerate(self.numbers)}
        self._road = road
        self._price = self._prices()

    def path(self, number: int) -> Path:
        """Return a lanelet's centre line."""
        return self.paths[self._place[number]]

    def _prices(self) -> Float64[np.ndarray, "from to"]:
        count = len(self.numbers)
        follows = np.zeros((count, count), bool)
        price = np.full((count, count), GAP)
        for place, lanelet in enumerate(self._road.lanelets.values()):
            for beside in (lanelet.adjacent_left, lanelet.adjacent_right):
                if beside is not None and beside[1] and beside[0] in self._place:
                    price[place, self._place[beside[0]]] = LANE_CHANGE
            for number in lanelet.successors:
                if number in self._place:
                    follows[place, self._place[number]] = True
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
        for place, path in enumerate(self.paths):
            seen = path.coordinates(x, y)
            beyond = np.maximum(seen.along - path.length, 0) + np.maximum(-seen.along, 0)
            metres[:, place] = abs(seen.lateral) + beyond
            radians[:, place] = abs(wrapped(heading - seen.heading))
        return metres + radians, metres

    def match(self, tracks: Tracks, number: int) -> Matched:
        """Find the lanelets of one track."""
        rows = slice(*tracks.starts[number : number + 2])
        misfit, metres = self.misfit(tracks.x[rows], tracks.y[rows], tracks.heading[rows])
        chosen = self._cheapest(misfit)
        sequence, place = [int(chosen[0])], np.zeros(len(chosen), np.int64)
        for state in range(1, len(chosen)):
            if chosen[state] != sequence[-1]:
                sequence += self._between(sequence[-1], int(chosen[state]))
            place[state] = len(sequence) - 1
        lanelets = [int(self.numbers[one]) for one in sequence]
        nearest = self.numbers[np.argmin(misfit, axis=1)]
        off = float(metres[np.arange(len(chosen)), chosen].mean())
        return Matched(tuple(lanelets + self._onwards(lanelets[-1])), place, nearest, off)

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
            following = [one for one in self._next(way[-1], False) if one not in way]
            if not following:
                break
            way.append(min(following, key=lambda one: _bend(self._road, one)))
            length += self.path(way[-1]).length
        return way[1:]

    def section(self, lanelets: list[int], backwards: bool, least: float = 0.0) -> Path | None:
        """Return the line along consecutive lanelets, without parallel lanes.

        Args:
            lanelets: Part of a sequence.
            backwards: Keep the last lanelet and what leads to it; otherwise the first and on.
            least: m; a shorter line is continued beyond the sequence, if the road continues.
        """
        kept: list[int] = []
        for number in reversed(lanelets) if backwards else lanelets:
            if not kept or number in self._next(kept[-1], backwards):
                kept.append(number)
        if not kept:
            return None
        length = sum(self.path(number).length for number in kept)
        while length < least:
            onwards = [n for n in self._next(kept[-1], backwards) if n not in kept]
            if not onwards:
                break
            kept.append(min(onwards, key=lambda number: _bend(self._road, number)))
            length += self.path(kept[-1]).length
        if len(kept) == 1:
            return self.path(kept[0])
        points = [self._road.lanelets[n].centre for n in (kept[::-1] if backwards else kept)]
        return path_of(np.concatenate(points))

    def _next(self, number: int, backwards: bool) -> list[int]:
        lanelet = self._road.lanelets[number]
        following = lanelet.predecessors if backwards else lanelet.successors
        return [one for one in following if one in self._place]

    def crossing(self, matched: Matched, lanes: Lanes, junction: int) -> Crossing | None:
        """Return a track's way over a junction; None if it doesn't touch it."""
        inside = [number in lanes.junctions[junction].lanelets for number in matched.lanelets]
        if not any(inside):
            return None
        first = inside.index(True)
        last = len(inside) - 1 - inside[::-1].index(True)
        sequence = list(matched.lanelets)
        way = self.section(sequence[first : last + 1], True)
        assert way is not None  # it holds the lanelet `first`
        approach = self.section(sequence[:first], True, AHEAD)
        sections = approach, way, self.section(sequence[last + 1 :], False, AHEAD)
        part = np.full(len(matched.place), JUNCTION)
        part[matched.place < first] = APPROACH
        part[matched.place > last] = EXIT
        return Crossing(junction, first, last, sections, part)


def _bend(road: RoadNetwork, number: int) -> float:
    steps = np.diff(road.lanelets[number].centre, axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    return float(abs(wrapped(heading[-1:] - heading[:1]))[0])
