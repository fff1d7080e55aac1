"""Road networks of Lanelet2 maps (OSM XML), as inD, rounD, exiD and INTERACTION bring them.

The file is read, projected and routed by the library lanelet2 (FZI and KIT, BSD; extra `lanelet2`),
which only this module imports, in a separate process; its rules of vehicles in Germany say which
lanelet follows which. The format: Poggenhans et al., "Lanelet2: A high-definition map framework"
(ITSC 2018).
"""

import functools
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring, tostring

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import read_bytes
from socialiq_recordings import DISTRIBUTION
from socialiq_recordings.road.network import Elements, Lanelet, RoadNetwork, Sign, equal_bounds

_MOST_BYTES = 64 << 20
_MOST_SECONDS = 300
_ANSWER = "\x1elanelets "  # before the answer, after whatever the library prints
_NODE = re.compile(rb"<node\b[^>]*>")
_LOCAL = re.compile(rb"<tag\s+k=['\"]local_x['\"]")
_ERROR = re.compile(r"primitive (?:with id )?(-?\d+)[^:]*: (.*)", re.DOTALL)
_NAMED = 100  # errors of the library that are named
_LISTED = 3  # errors that a refusal lists
_SOMEWHERE = 48.0, 9.0  # degrees, in the middle of a UTM zone
_PLACE = (re.compile(rb"\blat=['\"]([^'\"]+)"), re.compile(rb"\blon=['\"]([^'\"]+)"))

_SIGNS = {"TrafficLight": Sign.LIGHT, "AllWayStop": Sign.STOP}

_Key = tuple[int, bool]  # number, and whether it is driven backwards


def read_lanelet2(
    path: Path,
    utm_origin: tuple[float, float] | None = None,
    origin: tuple[float, float] | None = None,
) -> RoadNetwork:
    """Read the lanelets of a map, OSM XML, that vehicles may drive on; faulty ones are named.

    Args:
        path: The map.
        utm_origin: Origin of the tracks' frame in UTM coordinates, m, as a `recordingMeta.csv` of
            inD has them.
        origin: Latitude and longitude of that origin, degrees. Without both it is that of `local_x`
            and `local_y` where all nodes have them, also if none has lat and lon, else 0° N 0° E as
            in INTERACTION.

    Raises:
        UserError: If it can't be read, holds no such lanelet, or lanelet2 is not installed.
    """
    optional("lanelet2", "lanelet2", "a Lanelet2 map", DISTRIBUTION)
    content = read_bytes(path, _MOST_BYTES)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise UserError(f"{path} declares a document type: remove it; Lanelet2 maps have none")
    # The library gets a copy, because the file could be another one by now.
    with tempfile.NamedTemporaryFile(suffix=path.suffix) as copy:
        copy.write(content)
        copy.flush()
        output = _output_of_library(path, [copy.name, utm_origin, origin])
    output = output.replace(copy.name, str(path))
    answers = [json.loads(text) for text in output.split(_ANSWER)[1:]]
    faults = answers[0] if answers else []
    answer = answers[1] if len(answers) > 1 else {}
    listed = "".join(f"; {name}: {one_line(reason)}" for name, reason in faults[:_LISTED])
    if "lanelets" not in answer:
        ended = (
            "lanelet2 ended without an answer; check its references of nodes, ways and regulatory "
            "elements"
        )
        reason = one_line(answer.get("error", ended))
        fault = "" if "--origin" in reason else " is not a Lanelet2 map"
        raise UserError(f"{path}{fault}: {reason}{listed}")
    elements = Elements(path)
    for name, reason in faults:
        elements.leave_out(name, reason)
    for values in answer["lanelets"]:
        elements.add(f"lanelet {values['identity']}", functools.partial(_lanelet, values))
    road = elements.road()
    if not road.lanelets:
        raise UserError(f"{path} holds no lanelet for vehicles: name a map that does{listed}")
    return road


def _output_of_library(path: Path, request: list[Any]) -> str:
    """Run `serve` in a process, which a damaged file can end; return what it printed."""
    try:
        return subprocess.run(
            [sys.executable, "-c", f"from {__name__} import serve; serve()"],
            input=json.dumps(request),
            capture_output=True,
            text=True,
            timeout=_MOST_SECONDS,
            check=False,
            env=os.environ
            | {"PYTHONPATH": os.pathsep.join(folder for folder in sys.path if folder)},
        ).stdout
    except subprocess.TimeoutExpired as error:
        raise UserError(f"{path}: lanelet2 needs more than {_MOST_SECONDS} s") from error
    except OSError as error:
        raise UserError(f"{path}: lanelet2 cannot be started: {error.strerror}") from error


def _lanelet(values: dict[str, Any]) -> Lanelet:
    if "fault" in values:
        raise ValueError(values["fault"])
    for name in ("left", "right", "stop_line"):
        values[name] = None if values[name] is None else np.array(values[name])
    for name in ("successors", "predecessors", "adjacent_left", "adjacent_right"):
        values[name] = None if values[name] is None else tuple(values[name])
    values["sign"] = Sign(values["sign"])
    return Lanelet(**values)


def serve() -> None:
    """Read the map that standard input names, and write its errors and its lanelets as JSON."""
    name, utm_origin, origin = json.load(sys.stdin)
    faults: list[tuple[str, str]] = []
    try:
        library = optional("lanelet2", "lanelet2", "a Lanelet2 map", DISTRIBUTION)
        projector, shift = _projector(library, Path(name), utm_origin, origin)
        loaded, errors = library.io.loadRobust(name, projector)
        matches = [_ERROR.search(error) for error in errors]
        faults = [(f"primitive {match[1]}", match[2]) for match in matches if match]
    except Exception as error:  # of the library's own kinds, and ours
        sys.stdout.write(_ANSWER + "[]" + _ANSWER + json.dumps({"error": str(error)}))
        return
    sys.stdout.write(_ANSWER + json.dumps(faults[:_NAMED]))
    sys.stdout.flush()  # before what a damaged map may end
    try:
        bad = {int(name.removeprefix("primitive ")) for name, _ in faults}
        road = _Road(library, loaded, shift, bad)
        answer: dict[str, Any] = {"lanelets": [*road.lanelets(), *road.left_out]}
    except Exception as error:
        answer = {"error": str(error)}
    sys.stdout.write(_ANSWER + json.dumps(answer))


def _projector(
    library: Any,
    path: Path,
    utm_origin: tuple[float, float] | None,
    origin: tuple[float, float] | None,
) -> tuple[Any, np.ndarray | None]:
    """Return a projector to UTM, and the coordinates to subtract; None: local ones are meant."""
    content = read_bytes(path, _MOST_BYTES)
    nodes = _NODE.findall(content)
    has_local = len(_LOCAL.findall(content)) == len(nodes)
    texts = [[pattern.search(node) for pattern in _PLACE] for node in nodes]
    if nodes and not any(all(pair) for pair in texts) and has_local:
        if utm_origin is not None or origin is not None:
            raise UserError(
                "no node has lat and lon, which the origin of the tracks' frame needs: name a map "
                "with both, or leave out --origin where local_x and local_y are in that frame"
            )
        return _placed_by_local(library, path, content), None
    try:
        latitude, longitude = (float(text[1]) for text in texts[0] if text)
    except (ValueError, IndexError) as error:
        raise UserError("its first node has no lat and lon") from error
    if not (-80 <= latitude <= 84 and -180 <= longitude <= 180):
        raise UserError(f"no UTM zone holds its first node, {latitude:g} {longitude:g}")
    project = library.projection.UtmProjector
    zone = library.io.Origin(latitude, longitude)
    if utm_origin is not None:
        return project(zone, False, False), np.array(utm_origin)
    if origin is None and has_local:
        return project(zone, False, False), None
    projector = project(library.io.Origin(*(origin or (0.0, 0.0))))  # which subtracts by itself
    try:
        projector.forward(library.core.GPSPoint(latitude, longitude, 0.0))
    except Exception as error:
        stated = f"{origin[0]:g} {origin[1]:g}" if origin else "0 0, as in INTERACTION,"
        raise UserError(
            f"its first node, {latitude:g} {longitude:g}, lies in another UTM zone than the origin "
            f"{stated} of the tracks' frame: state its latitude and longitude with --origin at "
            "`socialiq data import`"
        ) from error
    return projector, np.zeros(2)


def _placed_by_local(library: Any, path: Path, content: bytes) -> Any:
    """Write lat and lon into a map that has local coordinates alone; return their projector.

    The library joins and orients lanelets by projected points; the lanelets' own points stay the
    local ones.
    """
    projector = library.projection.UtmProjector(library.io.Origin(*_SOMEWHERE))
    root = fromstring(content)
    first = None
    for node in root.iter("node"):
        tags = {tag.get("k"): tag.get("v", "") for tag in node.iter("tag")}
        try:
            place = np.array([float(tags[name]) for name in ("local_x", "local_y")])
        except (KeyError, ValueError):
            place = np.full(2, np.nan)
        if not np.isfinite(place).all():
            name = one_line(node.get("id", ""), 40)
            raise UserError(f"node {name} has no numbers local_x and local_y")
        first = place if first is None else first
        point = projector.reverse(library.core.BasicPoint3d(*(place - first).tolist(), 0.0))
        node.set("lat", repr(point.lat))
        node.set("lon", repr(point.lon))
    path.write_bytes(tostring(root))
    return projector


class _Road:
    """Builder of lanelets as plain values from a routing graph."""

    def __init__(self, library: Any, loaded: Any, origin: np.ndarray | None, bad: set[int]) -> None:
        lanelets = list(loaded.laneletLayer)
        sound = []
        self.left_out: list[dict[str, Any]] = []
        for lanelet in lanelets:
            bounds = (lanelet.leftBound, lanelet.rightBound)
            numbers = {part.id for line in bounds for part in (line, *line)}
            if min(map(len, bounds)) < 2:
                fault = "a bound has fewer than two points"
            elif bad & numbers:
                fault = f"its bounds have the primitive {min(bad & numbers)}, which is bad"
            else:
                sound.append(lanelet)
                continue
            self.left_out.append({"identity": lanelet.id, "fault": fault})
        if self.left_out:  # which would end the process
            loaded = library.core.createMapFromLanelets(sound)
        self._lanelets = sound
        country = library.traffic_rules.Locations.Germany
        vehicle = library.traffic_rules.Participants.Vehicle
        self._rules = library.traffic_rules.create(country, vehicle)
        self._graph = library.routing.RoutingGraph(loaded, self._rules)
        self._origin = origin
        self._numbers: dict[_Key, int] = {}

    def lanelets(self) -> list[dict[str, Any]]:
        lanelets = self._lanelets
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
        graph = self._graph
        sign, line = self._sign(lanelet)
        beside = {
            "adjacent_left": graph.left(lanelet) or graph.adjacentLeft(lanelet),
            "adjacent_right": graph.right(lanelet) or graph.adjacentRight(lanelet),
        }
        numbers = {
            name: None if near is None else self._numbers.get(_key(near))
            for name, near in beside.items()
        }
        row: dict[str, Any] = {
            "identity": self._numbers[_key(lanelet)],
            "left": left.tolist(),
            "right": right.tolist(),
            "successors": self._numbers_of(graph.following(lanelet)),
            "predecessors": self._numbers_of(graph.previous(lanelet)),
        }
        row |= {name: None if n is None else (n, True) for name, n in numbers.items()}
        row |= {"speed_limit": limit if 0 < limit < 100 else np.inf, "sign": int(sign)}
        return row | {"stop_line": None if line is None else line.tolist()}

    def _points(self, line: Any) -> np.ndarray:
        places = [
            (point.x, point.y)
            if self._origin is not None
            else (float(point.attributes["local_x"]), float(point.attributes["local_y"]))
            for point in line
        ]
        points = np.array(places, np.float64).reshape(-1, 2)
        return points if self._origin is None else points - self._origin

    def _numbers_of(self, lanelets: Any) -> list[int]:
        keys = (_key(lanelet) for lanelet in lanelets)
        return [self._numbers[key] for key in keys if key in self._numbers]

    def _sign(self, lanelet: Any) -> tuple[Sign, np.ndarray | None]:
        """Return a lanelet's right of way and its stop line; a light takes precedence."""
        sign = Sign.NONE
        line = None
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
