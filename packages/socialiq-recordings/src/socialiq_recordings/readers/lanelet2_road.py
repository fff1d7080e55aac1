"""Road networks of Lanelet2 maps (OSM XML), as inD, rounD, exiD and INTERACTION bring them.

The file is read, projected and routed by the library lanelet2 (FZI and KIT, BSD; extra `lanelet2`),
which only this module imports, in a process of its own; its rules of vehicles in Germany say which
lanelet follows which.
The format: Poggenhans et al., "Lanelet2: A high-definition map framework" (ITSC 2018).
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import read_bytes
from socialiq_recordings import DISTRIBUTION
from socialiq_recordings.road.network import Lanelet, RoadNetwork, Sign, equal_bounds

_MOST_BYTES = 64 << 20
_MOST_SECONDS = 300
_ANSWER = "\x1elanelets "  # before the answer, after whatever the library prints
_NODE = re.compile(rb"<node\b[^>]*>")
_PLACE = (re.compile(rb"\blat=['\"]([^'\"]+)"), re.compile(rb"\blon=['\"]([^'\"]+)"))

_Key = tuple[int, bool]  # number, and whether it is driven backwards


def read_lanelet2(path: Path, utm_origin: tuple[float, float] | None = None) -> RoadNetwork:
    """Read the lanelets of a map that vehicles may drive on.

    Args:
        path: The map, OSM XML.
        utm_origin: UTM coordinates of the origin of the tracks' frame, m, as a `recordingMeta.csv`
            of inD has them; None for INTERACTION's frame, whose origin is 0° N 0° E.

    Raises:
        UserError: If it can't be read, holds no such lanelet, or lanelet2 is not installed.
    """
    optional("lanelet2", "lanelet2", "a Lanelet2 map", DISTRIBUTION)
    _check_content(path)
    answer = _in_a_process(path, utm_origin)
    try:
        road = RoadNetwork({values["identity"]: _of_plain(values) for values in answer})
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    if not road.lanelets:
        raise UserError(f"{path} holds no lanelet for vehicles: name a map that does")
    return road


def _check_content(path: Path) -> None:
    content = read_bytes(path, _MOST_BYTES)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise UserError(f"{path} declares a document type: remove it; Lanelet2 maps have none")


def _in_a_process(path: Path, utm_origin: tuple[float, float] | None) -> list[dict[str, Any]]:
    """Return the lanelets as plain values, read by a process of its own.

    The library dereferences what a damaged file lacks, which would end this process.
    """
    request = json.dumps({"path": str(path.resolve()), "utm_origin": utm_origin})
    code = f"from {__name__} import serve; serve()"
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            input=request,
            capture_output=True,
            text=True,
            timeout=_MOST_SECONDS,
            check=False,
            env=os.environ
            | {"PYTHONPATH": os.pathsep.join(folder for folder in sys.path if folder)},
        )
        told = json.loads(done.stdout.rpartition(_ANSWER)[2])
    except subprocess.TimeoutExpired as error:
        raise UserError(f"{path}: lanelet2 needs more than {_MOST_SECONDS} s") from error
    except (OSError, ValueError) as error:
        raise UserError(
            f"{path} is not a Lanelet2 map: lanelet2 ended without an answer; check its references "
            "of nodes, ways and regulatory elements"
        ) from error
    if "error" in told:
        raise UserError(f"{path} is not a Lanelet2 map: {one_line(told['error'])}")
    return told["lanelets"]


def serve() -> None:
    """Read the map that standard input names, and write its lanelets as JSON."""
    request = json.load(sys.stdin)
    try:
        told: dict[str, Any] = {"lanelets": _read(Path(request["path"]), request["utm_origin"])}
    except Exception as error:  # of the library's own kinds, and ours
        told = {"error": str(error)}
    sys.stdout.write(_ANSWER + json.dumps(told))


def _read(path: Path, utm_origin: tuple[float, float] | None) -> list[dict[str, Any]]:
    library = optional("lanelet2", "lanelet2", "a Lanelet2 map", DISTRIBUTION)
    projector, origin = _projector(library, path, utm_origin)
    map_read, _ = library.io.loadRobust(str(path), projector)
    rules = library.traffic_rules.create(
        library.traffic_rules.Locations.Germany, library.traffic_rules.Participants.Vehicle
    )
    graph = library.routing.RoutingGraph(map_read, rules)
    return [_plain(lanelet) for lanelet in _Road(graph, rules, np.array(origin)).lanelets(map_read)]


def _plain(one: Lanelet) -> dict[str, Any]:
    return {
        "identity": one.identity,
        "left": one.left.tolist(),
        "right": one.right.tolist(),
        "successors": one.successors,
        "predecessors": one.predecessors,
        "adjacent_left": one.adjacent_left,
        "adjacent_right": one.adjacent_right,
        "speed_limit": one.speed_limit,
        "sign": int(one.sign),
        "stop_line": None if one.stop_line is None else one.stop_line.tolist(),
    }


def _of_plain(one: dict[str, Any]) -> Lanelet:
    left, right = (
        None if one[side] is None else (int(one[side][0]), bool(one[side][1]))
        for side in ("adjacent_left", "adjacent_right")
    )
    return Lanelet(
        int(one["identity"]),
        np.array(one["left"]),
        np.array(one["right"]),
        tuple(one["successors"]),
        tuple(one["predecessors"]),
        left,
        right,
        speed_limit=float(one["speed_limit"]),
        sign=Sign(one["sign"]),
        stop_line=None if one["stop_line"] is None else np.array(one["stop_line"]),
    )


def _projector(
    library: Any, path: Path, utm_origin: tuple[float, float] | None
) -> tuple[Any, tuple[float, float]]:
    """Return a projector to UTM, and the coordinates to subtract."""
    node = _NODE.search(read_bytes(path, _MOST_BYTES))
    texts = [pattern.search(node[0]) if node else None for pattern in _PLACE]
    try:
        latitude, longitude = (float(text[1]) for text in texts if text)
    except ValueError as error:
        raise UserError("no node has lat and lon") from error
    if not (-80 <= latitude <= 84 and -180 <= longitude <= 180):
        raise UserError(f"no UTM zone holds its first node, {latitude:g} {longitude:g}")
    if utm_origin is None:
        # Relative to 0° N 0° E, the library subtracts by itself.
        zero = library.io.Origin(0.0, 0.0)
        return library.projection.UtmProjector(zero), (0.0, 0.0)
    zone = library.io.Origin(latitude, longitude)
    return library.projection.UtmProjector(zone, False, False), utm_origin


class _Road:
    """Builder of a road network from a routing graph."""

    def __init__(self, graph: Any, rules: Any, origin: np.ndarray) -> None:
        self._graph, self._rules, self._origin = graph, rules, origin
        self._numbers: dict[_Key, int] = {}

    def lanelets(self, found: Any) -> Iterator[Lanelet]:
        lanelets = list(found.laneletLayer)
        driven = [lanelet for lanelet in lanelets if self._rules.canPass(lanelet)]
        for drivable in driven:
            self._numbers[_key(drivable)] = drivable.id
        free = 1 + max([0, *(lanelet.id for lanelet in lanelets)])
        backwards = [drivable.invert() for drivable in driven if not self._rules.isOneWay(drivable)]
        for number, drivable in enumerate(backwards, free):
            self._numbers[_key(drivable)] = number
        return (self._lanelet(drivable) for drivable in (*driven, *backwards))

    def _lanelet(self, one: Any) -> Lanelet:
        left, right = equal_bounds(self._points(one.leftBound), self._points(one.rightBound))
        limit = float(self._rules.speedLimit(one).speedLimit) / 3.6
        sign, line = self._sign(one)
        return Lanelet(
            identity=self._numbers[_key(one)],
            left=left,
            right=right,
            successors=self._of(self._graph.following(one)),
            predecessors=self._of(self._graph.previous(one)),
            adjacent_left=self._beside(self._graph.left(one) or self._graph.adjacentLeft(one)),
            adjacent_right=self._beside(self._graph.right(one) or self._graph.adjacentRight(one)),
            speed_limit=limit if 0 < limit < 100 else np.inf,
            sign=sign,
            stop_line=line,
        )

    def _points(self, line: Any) -> np.ndarray:
        points = np.array([(point.x, point.y) for point in line], np.float64).reshape(-1, 2)
        return points - self._origin

    def _of(self, lanelets: Any) -> tuple[int, ...]:
        keys = (_key(lanelet) for lanelet in lanelets)
        return tuple(self._numbers[key] for key in keys if key in self._numbers)

    def _beside(self, other: Any) -> tuple[int, bool] | None:
        if other is None or _key(other) not in self._numbers:
            return None
        return self._numbers[_key(other)], True

    def _sign(self, one: Any) -> tuple[Sign, np.ndarray | None]:
        """Return a lanelet's right of way and its stop line; a light takes precedence."""
        sign, line = Sign.NONE, None
        for rule in one.regulatoryElements:
            kind = type(rule).__name__
            kind_of_sign = Sign.NONE
            if kind == "TrafficLight":
                kind_of_sign = Sign.LIGHT
            elif kind == "AllWayStop":
                kind_of_sign = Sign.STOP
            elif kind == "RightOfWay":
                manoeuvre = str(rule.getManeuver(one))
                kind_of_sign = Sign.YIELD if manoeuvre.endswith("Yield") else Sign.NONE
                kind_of_sign = Sign.PRIORITY if manoeuvre.endswith("RightOfWay") else kind_of_sign
            sign = max(sign, kind_of_sign)
            stop = getattr(rule, "stopLine", None)
            if stop is not None and len(stop) >= 2 and kind_of_sign in (Sign.YIELD, Sign.LIGHT):
                line = self._points(stop)[[0, -1]]
        return sign, line


def _key(one: Any) -> _Key:
    return one.id, bool(one.inverted())
