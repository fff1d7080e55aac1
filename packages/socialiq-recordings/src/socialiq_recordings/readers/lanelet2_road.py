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

_SIGNS = {"TrafficLight": Sign.LIGHT, "AllWayStop": Sign.STOP}

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
    content = read_bytes(path, _MOST_BYTES)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise UserError(f"{path} declares a document type: remove it; Lanelet2 maps have none")
    try:
        # The library dereferences what a damaged file lacks, which would end this process.
        done = subprocess.run(
            [sys.executable, "-c", f"from {__name__} import serve; serve()"],
            input=json.dumps({"path": str(path.resolve()), "utm_origin": utm_origin}),
            capture_output=True,
            text=True,
            timeout=_MOST_SECONDS,
            check=False,
            env=os.environ
            | {"PYTHONPATH": os.pathsep.join(folder for folder in sys.path if folder)},
        )
        answer = json.loads(done.stdout.rpartition(_ANSWER)[2])
    except subprocess.TimeoutExpired as error:
        raise UserError(f"{path}: lanelet2 needs more than {_MOST_SECONDS} s") from error
    except (OSError, ValueError) as error:
        raise UserError(
            f"{path} is not a Lanelet2 map: lanelet2 ended without an answer; check its references "
            "of nodes, ways and regulatory elements"
        ) from error
    if "error" in answer:
        raise UserError(f"{path} is not a Lanelet2 map: {one_line(answer['error'])}")
    lanelets = {}
    for values in answer["lanelets"]:
        for name in ("left", "right", "stop_line"):
            values[name] = None if values[name] is None else np.array(values[name])
        for name in ("successors", "predecessors", "adjacent_left", "adjacent_right"):
            values[name] = None if values[name] is None else tuple(values[name])
        try:
            lanelets[values["identity"]] = Lanelet(**values | {"sign": Sign(values["sign"])})
        except UserError as error:
            raise UserError(f"{path}: {error}") from error
    if not lanelets:
        raise UserError(f"{path} holds no lanelet for vehicles: name a map that does")
    return RoadNetwork(lanelets)


def serve() -> None:
    """Read the map that standard input names, and write its lanelets as JSON."""
    request = json.load(sys.stdin)
    try:
        library = optional("lanelet2", "lanelet2", "a Lanelet2 map", DISTRIBUTION)
        path = Path(request["path"])
        projector, origin = _projector(library, path, request["utm_origin"])
        loaded, _ = library.io.loadRobust(str(path), projector)
        lanelets = _Road(library, loaded, np.array(origin)).lanelets(loaded)
        answer: dict[str, Any] = {"lanelets": lanelets}
    except Exception as error:  # of the library's own kinds, and ours
        answer = {"error": str(error)}
    sys.stdout.write(_ANSWER + json.dumps(answer))


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
    """Builder of lanelets as plain values from a routing graph."""

    def __init__(self, library: Any, loaded: Any, origin: np.ndarray) -> None:
        country = library.traffic_rules.Locations.Germany
        vehicle = library.traffic_rules.Participants.Vehicle
        self._rules = library.traffic_rules.create(country, vehicle)
        self._graph = library.routing.RoutingGraph(loaded, self._rules)
        self._origin = origin
        self._numbers: dict[_Key, int] = {}

    def lanelets(self, loaded: Any) -> list[dict[str, Any]]:
        lanelets = list(loaded.laneletLayer)
        driven = [lanelet for lanelet in lanelets if self._rules.canPass(lanelet)]
        for drivable in driven:
            self._numbers[_key(drivable)] = drivable.id
        free = 1 + max([0, *(lanelet.id for lanelet in lanelets)])
        backwards = [drivable.invert() for drivable in driven if not self._rules.isOneWay(drivable)]
        for number, drivable in enumerate(backwards, free):
            self._numbers[_key(drivable)] = number
        return [self._plain(drivable) for drivable in (*driven, *backwards)]

    def _plain(self, lanelet: Any) -> dict[str, Any]:
        left, right = equal_bounds(*map(self._points, (lanelet.leftBound, lanelet.rightBound)))
        limit = float(self._rules.speedLimit(lanelet).speedLimit) / 3.6
        graph, (sign, line) = self._graph, self._sign(lanelet)
        beside = {
            "adjacent_left": graph.left(lanelet) or graph.adjacentLeft(lanelet),
            "adjacent_right": graph.right(lanelet) or graph.adjacentRight(lanelet),
        }
        numbers = {
            name: None if near is None else self._numbers.get(_key(near))
            for name, near in beside.items()
        }
        return {
            "identity": self._numbers[_key(lanelet)],
            "left": left.tolist(),
            "right": right.tolist(),
            "successors": self._numbers_of(graph.following(lanelet)),
            "predecessors": self._numbers_of(graph.previous(lanelet)),
            **{name: None if n is None else (n, True) for name, n in numbers.items()},
            "speed_limit": limit if 0 < limit < 100 else np.inf,
            "sign": int(sign),
            "stop_line": None if line is None else line.tolist(),
        }

    def _points(self, line: Any) -> np.ndarray:
        points = np.array([(point.x, point.y) for point in line], np.float64).reshape(-1, 2)
        return points - self._origin

    def _numbers_of(self, lanelets: Any) -> list[int]:
        keys = (_key(lanelet) for lanelet in lanelets)
        return [self._numbers[key] for key in keys if key in self._numbers]

    def _sign(self, lanelet: Any) -> tuple[Sign, np.ndarray | None]:
        """Return a lanelet's right of way and its stop line; a light takes precedence."""
        sign, line = Sign.NONE, None
        for rule in lanelet.regulatoryElements:
            kind = type(rule).__name__
            sign_of_rule = _SIGNS.get(kind, Sign.NONE)
            if kind == "RightOfWay":
                manoeuvre = str(rule.getManeuver(lanelet))
                sign_of_rule = Sign.YIELD if manoeuvre.endswith("Yield") else Sign.NONE
                sign_of_rule = Sign.PRIORITY if manoeuvre.endswith("RightOfWay") else sign_of_rule
            sign = max(sign, sign_of_rule)
            stop = getattr(rule, "stopLine", None)
            if stop is not None and len(stop) >= 2 and sign_of_rule in (Sign.YIELD, Sign.LIGHT):
                line = self._points(stop)[[0, -1]]
        return sign, line


def _key(lanelet: Any) -> _Key:
    return lanelet.id, bool(lanelet.inverted())
