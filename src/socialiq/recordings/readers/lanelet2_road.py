"""Road networks of Lanelet2 maps (OSM XML), as inD, rounD, exiD and INTERACTION bring them.

The file is read, projected and routed by the library lanelet2 (FZI and KIT, BSD; extra `lanelet2`),
which only this module imports: its rules of vehicles in Germany say which lanelet follows which.
The format: Poggenhans et al., "Lanelet2: A high-definition map framework" (ITSC 2018).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import read_bytes
from socialiq.recordings.road.network import Lanelet, RoadNetwork, Sign, equal_bounds

_MOST_BYTES = 64 << 20
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
    library = optional("lanelet2", "lanelet2", "a Lanelet2 map")
    projector, origin = _projector(library, path, utm_origin)
    try:
        found, errors = library.io.loadRobust(str(path), projector)
        rules = library.traffic_rules.create(
            library.traffic_rules.Locations.Germany, library.traffic_rules.Participants.Vehicle
        )
        graph = library.routing.RoutingGraph(found, rules)
        road = _Road(graph, rules, np.array(origin)).network(list(found.laneletLayer))
    except (RuntimeError, ValueError, IndexError) as error:
        raise UserError(f"{path} is not a Lanelet2 map: {one_line(str(error))}") from error
    if not road.lanelets:
        said = f": {one_line(str(errors[0]))}" if errors else ""
        raise UserError(f"{path} holds no lanelet for vehicles: name a map that does{said}")
    return road


def _projector(
    library: Any, path: Path, utm_origin: tuple[float, float] | None
) -> tuple[Any, tuple[float, float]]:
    """Return a projector to UTM, and the coordinates to subtract."""
    content = read_bytes(path, _MOST_BYTES)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise UserError(f"{path} declares a document type: remove it; Lanelet2 maps have none")
    node = _NODE.search(content)
    texts = [place.search(node[0]) if node else None for place in _PLACE]
    try:
        latitude, longitude = (float(text[1]) for text in texts if text)
    except ValueError as error:
        raise UserError(f"{path} is not a Lanelet2 map: no node has lat and lon") from error
    if not (-80 <= latitude <= 84 and -180 <= longitude <= 180):
        raise UserError(f"{path}: no UTM zone holds its first node, {latitude:g} {longitude:g}")
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

    def network(self, lanelets: list[Any]) -> RoadNetwork:
        driven = [one for one in lanelets if self._rules.canPass(one)]
        for one in driven:
            self._numbers[_key(one)] = one.id
        free = 1 + max([0, *(one.id for one in lanelets)])
        both = [one.invert() for one in driven if not self._rules.isOneWay(one)]
        for number, one in enumerate(both, free):
            self._numbers[_key(one)] = number
        made = (self._lanelet(one) for one in (*driven, *both))
        return RoadNetwork({one.identity: one for one in made})

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
        keys = (_key(one) for one in lanelets)
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
            found = Sign.NONE
            if kind == "TrafficLight":
                found = Sign.LIGHT
            elif kind == "AllWayStop":
                found = Sign.STOP
            elif kind == "RightOfWay":
                manoeuvre = str(rule.getManeuver(one))
                found = Sign.YIELD if manoeuvre.endswith("Yield") else Sign.NONE
                found = Sign.PRIORITY if manoeuvre.endswith("RightOfWay") else found
            sign = max(sign, found)
            stop = getattr(rule, "stopLine", None)
            if stop is not None and len(stop) >= 2 and found in (Sign.YIELD, Sign.LIGHT):
                line = self._points(stop)[[0, -1]]
        return sign, line


def _key(one: Any) -> _Key:
    return one.id, bool(one.inverted())
