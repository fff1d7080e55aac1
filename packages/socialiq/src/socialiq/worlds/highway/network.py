"""Roads as tables: lanes, the roads that follow, and the ways to a destination."""

import itertools
import math
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

Point = tuple[float, float]
Shape = dict[str, Any]

APPROACH, CONFLICT, EXIT = 0, 1, 4
"""Kinds of a lane, for the influence zone: before the place where ways meet, in it, behind it.

Kinds between 1 and 4 count as CONFLICT; the intersection numbers its ways across so.
"""

SHAPE: list[tuple[str, Any]] = [
    ("straight", np.bool_),  # also of a sine around a straight line
    ("length", np.float64),
    ("heading", np.float64),
    ("x", np.float64),  # start of a straight lane, centre of a circle
    ("y", np.float64),
    ("along_x", np.float64),
    ("along_y", np.float64),
    ("across_x", np.float64),
    ("across_y", np.float64),
    ("radius", np.float64),
    ("phase", np.float64),
    ("sense", np.float64),  # 1 clockwise as drawn, -1 the other way
    ("amplitude", np.float64),  # of a sine, m; 0: none
    ("pulsation", np.float64),  # rad/m
    ("shift", np.float64),  # rad
]
"""Fields of a lane's shape: a straight line, a sine around one, or an arc of a circle."""

LANE = np.dtype(
    [
        *SHAPE,
        ("forbidden", np.bool_),  # to change to
        ("speed_limit", np.float64),  # m/s
        ("road", np.int64),
        ("number", np.int64),  # on its road, from the left
        ("first", np.int64),  # the road's first lane
        ("lanes", np.int64),  # of the road
        ("start", np.int64),  # nodes
        ("end", np.int64),
        ("kind", np.int64),
        ("before", np.float64),  # metres of the task up to the road's start
        ("low_x", np.float64),  # box around the lane
        ("high_x", np.float64),
        ("low_y", np.float64),
        ("high_y", np.float64),
    ],
    align=True,
)
"""Lane record of a scene."""


class Lane(NamedTuple):
    """Shape of a lane and what it is for."""

    shape: Shape  # values of LANE's geometric fields
    kind: int  # APPROACH, CONFLICT or EXIT
    forbidden: bool = False  # whether changing to it is forbidden


def straight(start: Point, end: Point) -> Shape:
    """Return the shape of a straight lane."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.sqrt(dx * dx + dy * dy)
    along_x, along_y = dx / length, dy / length
    shape = {"straight": True, "length": length, "heading": math.atan2(dy, dx)}
    shape |= {"x": start[0], "y": start[1], "along_x": along_x, "along_y": along_y}
    return shape | {"across_x": -along_y, "across_y": along_x}


def sine(start: Point, end: Point, amplitude: float, pulsation: float, shift: float) -> Shape:
    """Return the shape of a lane that swings around a straight line."""
    swing = {"amplitude": amplitude, "pulsation": pulsation, "shift": shift}
    return straight(start, end) | swing


def arc(centre: Point, radius: float, start: float, end: float, sense: int) -> Shape:
    """Return the shape of a lane along a circle, between two phases in rad."""
    length = radius * (end - start) * sense
    circle = {"x": centre[0], "y": centre[1], "radius": radius, "phase": start, "sense": sense}
    return {"straight": False, "length": length} | circle


_ROOM = 0.01  # m around a lane's box; more than a point between two of the thousand can lie outside


def _write_box(lane: np.ndarray) -> None:
    """Write the bounds of a lane's points, a little too wide; of a sine, of its whole band."""
    along = np.linspace(0.0, float(lane["length"]), 1000)
    if lane["straight"]:
        sides = np.array([[-1.0], [1.0]]) * lane["amplitude"]
        x = lane["x"] + along * lane["along_x"] + sides * lane["across_x"]
        y = lane["y"] + along * lane["along_y"] + sides * lane["across_y"]
    else:
        phase = lane["sense"] * along / lane["radius"] + lane["phase"]
        x = lane["x"] + lane["radius"] * np.cos(phase)
        y = lane["y"] + lane["radius"] * np.sin(phase)
    for name, values in (("x", x), ("y", y)):
        lane[f"low_{name}"], lane[f"high_{name}"] = values.min() - _ROOM, values.max() + _ROOM


class Network:
    """Roads between nodes, each with lanes, in highway-env's order.

    That order decides between equally close lanes: nodes by their first mention as a start, of
    these the ends, of these the lanes.
    """

    def __init__(self) -> None:
        self._graph: dict[str, dict[str, list[Lane]]] = {}

    def add(self, start: str, end: str, lane: Lane) -> None:
        """Add a lane to the road between two nodes, to the right of those it has."""
        self._graph.setdefault(start, {}).setdefault(end, []).append(lane)

    @property
    def roads(self) -> list[tuple[str, str]]:
        """Roads in order, as pairs of nodes."""
        return [(start, end) for start, ends in self._graph.items() for end in ends]

    def lane(self, start: str, end: str, number: int) -> int:
        """Return the number of a lane among all."""
        before = self.roads[: self.roads.index((start, end))]
        return sum(len(self._graph[first][last]) for first, last in before) + number

    def lanes(self, task: Sequence[str] = ()) -> np.ndarray:
        """Return all lanes, LANE; `before` is NaN but on the ego's way, given by its nodes."""
        nodes, rows = sorted({node for road in self.roads for node in road}), []
        for number, (start, end) in enumerate(self.roads):
            parallel = self._graph[start][end]
            for rank, lane in enumerate(parallel):
                row = np.zeros((), LANE)
                for name, value in lane.shape.items():
                    row[name] = value
                row["forbidden"], row["kind"] = lane.forbidden, lane.kind
                row["speed_limit"], row["before"] = 20.0, np.nan
                row["road"], row["number"] = number, rank
                row["first"], row["lanes"] = len(rows) - rank, len(parallel)
                row["start"], row["end"] = nodes.index(start), nodes.index(end)
                _write_box(row)
                rows.append(row)
        lanes, metres = np.array(rows, LANE), 0.0
        for road in itertools.pairwise(task):
            on_road = lanes["road"] == self.roads.index(road)
            lanes["before"][on_road] = metres
            metres += float(lanes["length"][on_road][0])
        return lanes

    def successors(self) -> np.ndarray:
        """Return the roads that follow each, -1 beyond the last, (roads, most)."""
        following = [
            [self.roads.index((end, node)) for node in self._graph.get(end, {})]
            for _, end in self.roads
        ]
        table = np.full((len(following), max(map(len, following))), -1, np.int64)
        for row, roads in zip(table, following, strict=True):
            row[: len(roads)] = roads
        return table

    def routes(self, destinations: Sequence[str]) -> np.ndarray:
        """Return the shortest way from each road to each node, (roads, destinations, most).

        It is of roads, the first among them, and -1 beyond the last.
        """
        ways = [[self._way(road, node) for node in destinations] for road in self.roads]
        most = max((len(way) for row in ways for way in row), default=1)
        table = np.full((len(self.roads), max(len(destinations), 1), most), -1, np.int64)
        for road, row in enumerate(ways):
            for column, way in enumerate(row):
                table[road, column, : len(way)] = way
        return table

    def _way(self, road: tuple[str, str], goal: str) -> list[int]:
        """Return the first way of a breadth-first search, ends in alphabetical order."""
        waiting = deque([[road[1]]])
        while waiting:
            path = waiting.popleft()
            for node in sorted(set(self._graph.get(path[-1], {})) - set(path)):
                if node == goal:
                    roads = [road, *itertools.pairwise([*path, node])]
                    return [self.roads.index(pair) for pair in roads]
                waiting.append([*path, node])
        return [self.roads.index(road)]
