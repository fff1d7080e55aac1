"""Roads as tables: lanes, the roads that follow, and the ways to a destination."""

import itertools
import math
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

Point = tuple[float, float]
Shape = dict[str, Any]

APPROACH = 0
CONFLICT = 1
EXIT = 4
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
        ("slow_from", np.float64),  # m along it from which drivers roll to an all-way stop
        ("road", np.int64),
        ("number", np.int64),  # on its road, from the left
        ("first", np.int64),  # the road's first lane
        ("lanes", np.int64),  # of the road
        ("start", np.int64),  # nodes
        ("end", np.int64),
        ("kind", np.int64),
        ("priority", np.int64),  # of its vehicles where ways meet; the lower one yields
        ("before", np.float64),  # metres of the task up to the road's start
        ("low_x", np.float64),  # box around the lane
        ("high_x", np.float64),
        ("low_y", np.float64),
        ("high_y", np.float64),
        ("alone_from", np.float64),  # m along it between which no other lane is near
        ("alone_to", np.float64),
    ],
    align=True,
)
"""Lane record."""


CONNECTED = np.dtype([("lane", np.int64), ("offset", np.float64)], align=True)
"""Lane on which a driver may search for a leader, and metres to its start."""

LANE_WIDTH = 4.0  # m

CLOSE = 1.0
"""Misfit of a lane, m, below which no lane fits better where none is twice as near."""


class Lane(NamedTuple):
    """Shape of a lane and what it is for."""

    shape: Shape  # values of LANE's geometric fields
    kind: int  # APPROACH, CONFLICT or EXIT
    forbidden: bool = False  # whether changing to it is forbidden
    priority: int = 0
    slow_from: float = math.inf  # m along it; see `LANE`


def straight(start: Point, end: Point) -> Shape:
    """Return the shape of a straight lane.

    Args:
        start: Point (x, y) at which the lane begins, m.
        end: Point (x, y) at which it ends, m.
    """
    dx = end[0] - start[0]
    dy = end[1] - start[1]
    length = math.sqrt(dx * dx + dy * dy)
    along_x = dx / length
    along_y = dy / length
    shape = {"straight": True, "length": length, "heading": math.atan2(dy, dx)}
    shape |= {"x": start[0], "y": start[1], "along_x": along_x, "along_y": along_y}
    return shape | {"across_x": -along_y, "across_y": along_x}


def sine(start: Point, end: Point, amplitude: float, pulsation: float, shift: float) -> Shape:
    """Return the shape of a lane that swings around a straight line.

    Args:
        start: Point (x, y) at which the straight line begins, m.
        end: Point (x, y) at which it ends, m.
        amplitude: Largest distance from the line, m.
        pulsation: Angular frequency along the line, rad/m.
        shift: Phase of the sine at the start, rad.
    """
    swing = {"amplitude": amplitude, "pulsation": pulsation, "shift": shift}
    return straight(start, end) | swing


def arc(centre: Point, radius: float, start: float, end: float, sense: int) -> Shape:
    """Return the shape of a lane along a circle.

    Args:
        centre: Centre (x, y) of the circle, m.
        radius: Radius, m.
        start: Phase at which the lane begins, rad.
        end: Phase at which it ends, rad.
        sense: 1 if the lane runs clockwise as drawn, -1 if anticlockwise.
    """
    length = radius * (end - start) * sense
    circle = {"x": centre[0], "y": centre[1], "radius": radius, "phase": start, "sense": sense}
    return {"straight": False, "length": length} | circle


_ROOM = 0.01  # m around a lane's box; more than a point between two of the thousand can lie outside


_POINTS = 1000


def points(lane: np.void, count: int, aside: float | None = None) -> np.ndarray:
    """Return points on a lane.

    Args:
        lane: LANE record.
        count: Number of points.
        aside: Metres to the right of its straight line; None: as the lane swings around it.

    Returns:
        The coordinate along the lane, x and y, m, (3, count).
    """
    along = np.linspace(0.0, float(lane["length"]), count)
    if lane["straight"]:
        swing = lane["amplitude"] * np.sin(lane["pulsation"] * along + lane["shift"])
        right = swing if aside is None else aside
        x = lane["x"] + along * lane["along_x"] + right * lane["across_x"]
        y = lane["y"] + along * lane["along_y"] + right * lane["across_y"]
    else:
        phase = lane["sense"] * along / lane["radius"] + lane["phase"]
        x = lane["x"] + lane["radius"] * np.cos(phase)
        y = lane["y"] + lane["radius"] * np.sin(phase)
    return np.stack([along, x, y])


def mirrored(lanes: np.ndarray, sides: Point) -> np.ndarray:
    """Return the mirror image of lanes in a line through the origin, LANE.

    Args:
        lanes: LANE records.
        sides: Factors of x and y: (-1, 1) for the line along y, (1, -1) for the line along x.
    """
    image = lanes.copy()
    for axis, side in zip("xy", sides, strict=True):
        image[axis] *= side
        image[f"along_{axis}"] *= side
    image["across_x"] = -image["along_y"]
    image["across_y"] = image["along_x"]
    image["amplitude"] *= -1.0
    image["sense"] *= -1.0
    half_turn = math.pi if sides[0] < 0 else 0.0
    image["phase"] = half_turn - image["phase"]
    image["heading"] = np.arctan2(image["along_y"], image["along_x"]) * image["straight"]
    _write_boxes(image)
    _write_alone(image)
    return image


def _write_boxes(lanes: np.ndarray) -> None:
    """Write the bounds of each lane's points, a little too wide; of a sine, of its whole band."""
    for lane in lanes:
        sides = -lane["amplitude"], lane["amplitude"]
        band = np.hstack([points(lane, _POINTS, side)[1:] for side in sides])
        lane["low_x"], lane["low_y"] = band.min(axis=1) - _ROOM
        lane["high_x"], lane["high_y"] = band.max(axis=1) + _ROOM


def _write_alone(lanes: np.ndarray) -> None:
    """Write where each lane is alone: no other lane's box is within twice `CLOSE`."""
    for number, lane in enumerate(lanes):
        others = np.delete(lanes, number)[:, None]
        along, x, y = points(lane, _POINTS)
        beside = np.maximum(others["low_x"] - x, x - others["high_x"])
        beyond = np.maximum(others["low_y"] - y, y - others["high_y"])
        apart = np.maximum(beside, beyond).min(axis=0, initial=np.inf)
        near = np.flatnonzero(np.append(apart <= 2 * CLOSE + along[1], True))
        runs = np.diff(near, prepend=-1)  # one more than the points between
        end = int(near[runs.argmax()])
        lane["alone_from"] = (end - int(runs.max()) + 1) * along[1]
        lane["alone_to"] = (end - 1) * along[1]


class Network:
    """Roads between nodes, each with lanes, in highway-env's order.

    That order decides between equally close lanes: nodes by their first mention as a start, of
    these the ends, of these the lanes.
    """

    def __init__(self) -> None:
        self._graph: dict[str, dict[str, list[Lane]]] = {}

    def add(self, start: str, end: str, lane: Lane) -> None:
        """Add a lane to the road between two nodes, to the right of those it has.

        Args:
            start: Name of the node at which the road begins.
            end: Name of the node at which it ends.
            lane: Lane to add.
        """
        self._graph.setdefault(start, {}).setdefault(end, []).append(lane)

    @property
    def roads(self) -> list[tuple[str, str]]:
        """Roads in order, as pairs of nodes."""
        return [(start, end) for start, ends in self._graph.items() for end in ends]

    def lane(self, start: str, end: str, number: int) -> int:
        """Return the number of a lane among all.

        Args:
            start: Node at which its road begins.
            end: Node at which its road ends.
            number: Number of the lane on its road, from the left.
        """
        before = self.roads[: self.roads.index((start, end))]
        return sum(len(self._graph[first][last]) for first, last in before) + number

    def lanes(self, task: Sequence[str] = (), speed_limit: float = 20.0) -> np.ndarray:
        """Return all lanes, LANE.

        Args:
            task: Nodes of the ego's way; `before` is NaN on all other roads.
            speed_limit: Speed limit of every lane, m/s.
        """
        nodes = sorted({node for road in self.roads for node in road})
        rows = []
        for number, (start, end) in enumerate(self.roads):
            parallel = self._graph[start][end]
            for rank, lane in enumerate(parallel):
                row = np.zeros((), LANE)
                for name, value in lane.shape.items():
                    row[name] = value
                row["forbidden"] = lane.forbidden
                row["kind"] = lane.kind
                row["priority"] = lane.priority
                row["slow_from"] = lane.slow_from
                row["speed_limit"] = speed_limit
                row["before"] = np.nan
                row["road"] = number
                row["number"] = rank
                row["first"] = len(rows) - rank
                row["lanes"] = len(parallel)
                row["start"] = nodes.index(start)
                row["end"] = nodes.index(end)
                rows.append(row)
        lanes = np.array(rows, LANE)
        _write_boxes(lanes)
        _write_alone(lanes)
        metres = 0.0
        for road in itertools.pairwise(task):
            on_road = lanes["road"] == self.roads.index(road)
            lanes["before"][on_road] = metres
            metres += float(lanes["length"][on_road][0])
        return lanes

    def successors(self) -> np.ndarray:
        """Return the first lanes of the roads that follow each road, (roads, most)."""
        following = [
            [self.lane(end, node, 0) for node in self._graph.get(end, {})] for _, end in self.roads
        ]
        return _padded(following)

    def routes(self, destinations: Sequence[str]) -> np.ndarray:
        """Return the shortest way from each road to each node, (roads, destinations, most).

        A way is a list of the first lanes of its roads. It begins with the road from which it
        leads, and is filled up with -1.
        """
        ways = [self._way(road, node) for road in self.roads for node in destinations or [""]]
        return _padded(ways).reshape(len(self.roads), -1, max(map(len, ways)))

    def connected(self) -> np.ndarray:
        """Return the lanes that each lane is connected with: itself, those after and before it.

        Returns:
            CONNECTED records, (lanes, most), filled up with the number -1.
        """
        lanes = self.lanes()
        rows = []
        for number, lane in enumerate(lanes):
            straight_on = (lanes["lanes"] != lane["lanes"]) | (lanes["number"] == lane["number"])
            after = np.flatnonzero(straight_on & (lanes["start"] == lane["end"]))
            before = np.flatnonzero(straight_on & (lanes["end"] == lane["start"]))
            row = [(number, 0.0)]
            row += [(other, lane["length"]) for other in after]
            row += [(other, -lanes["length"][other]) for other in before]
            rows.append(row)
        table = np.full((len(rows), max(map(len, rows))), -1, CONNECTED)
        for connections, row in zip(table, rows, strict=True):
            connections[: len(row)] = row
        return table

    def _way(self, road: tuple[str, str], goal: str) -> list[int]:
        """Return the first way of a breadth-first search, ends in alphabetical order."""
        waiting = deque([[road[1]]])
        while waiting:
            path = waiting.popleft()
            for node in sorted(set(self._graph.get(path[-1], {})) - set(path)):
                if node == goal:
                    roads = [road, *itertools.pairwise([*path, node])]
                    return [self.lane(*pair, 0) for pair in roads]
                waiting.append([*path, node])
        return [self.lane(*road, 0)]


def _padded(rows: Sequence[Sequence[int]]) -> np.ndarray:
    """Return rows of different lengths as one array, filled up with -1."""
    table = np.full((len(rows), max(map(len, rows))), -1)
    for row, values in zip(table, rows, strict=True):
        row[: len(values)] = values
    return table
