"""Export of recordings as CommonRoad XML 2020a, with every digit."""

from collections.abc import Iterable
from itertools import count
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from socialiq.errors import UserError
from socialiq.storage import write_atomically
from socialiq_recordings.readers import commonroad_xml as xml
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Cycle, Lanelet, RoadNetwork, Sign

_SIGN_NUMBERS = {Sign.PRIORITY: "306", Sign.YIELD: "205", Sign.STOP: "206"}
_SPEED_LIMIT = "274"


def write_commonroad(recording: Recording, path: Path) -> None:
    """Write a recording as CommonRoad XML 2020a.

    A velocity that is not along the heading is written with a slip angle. Signs get the numbers
    of the format's fictitious country ZAM. The recording's name becomes the benchmark's; other
    readers require a name such as `ZAM_Cross-1_1_T-1`.

    Raises:
        UserError: If two elements have the same number, or the file can't be written.
    """
    tracks = recording.tracks
    road = recording.road
    taken = [*tracks.identity.tolist(), *road.lanelets]
    if len(set(taken)) < len(taken):
        twice = next(number for number in taken if taken.count(number) > 1)
        raise UserError(f"number {twice} has two elements: CommonRoad numbers each element once")
    root = Element(
        "commonRoad",
        timeStepSize=_decimal(tracks.dt),
        commonRoadVersion="2020a",
        benchmarkID=tracks.recording,
        author="socialiq",
        affiliation="",
        source=str(tracks.source.get("made_by", "socialiq")),
        date="2026-01-01",
    )
    SubElement(SubElement(root, "scenarioTags"), "intersection")
    _write_road(root, road, count(max(taken) + 1))
    _write_obstacles(root, tracks)
    indent(root, " ")
    text = tostring(root, encoding="unicode")
    write_atomically(path, f"<?xml version='1.0' encoding='utf-8'?>\n{text}\n")


def _add(parent: Element, name: str, text: str) -> None:
    SubElement(parent, name).text = text


def _write_road(root: Element, road: RoadNetwork, free: Iterable[int]) -> None:
    numbers = iter(free)
    signs: list[tuple[int, str, str]] = []
    lights: dict[int, Cycle | None] = {}
    for lanelet in road.lanelets.values():
        element = _write_lanelet(root, lanelet)
        if lanelet.sign == Sign.LIGHT:
            identity = next(numbers)
            lights[identity] = lanelet.cycle
            SubElement(element, "trafficLightRef", ref=str(identity))
        signed = [(_SIGN_NUMBERS[lanelet.sign], "")] if lanelet.sign in _SIGN_NUMBERS else []
        if np.isfinite(lanelet.speed_limit):
            signed.append((_SPEED_LIMIT, _decimal(lanelet.speed_limit)))
        for sign in signed:
            signs.append((next(numbers), *sign))
            SubElement(element, "trafficSignRef", ref=str(signs[-1][0]))
    for identity, number, value in signs:
        sign = SubElement(root, "trafficSign", id=str(identity))
        inside = SubElement(sign, "trafficSignElement")
        _add(inside, "trafficSignID", number)
        if value:
            _add(inside, "additionalValue", value)
        _add(sign, "virtual", "true")
    words = {colour: word for word, colour in xml.COLOURS.items()}
    for identity, cycle in lights.items():
        light = SubElement(root, "trafficLight", id=str(identity))
        # Other readers require a cycle also where its colours are unknown.
        element = SubElement(light, "cycle")
        for colour, length in cycle.phases if cycle else ():
            phase = SubElement(element, "cycleElement")
            _add(phase, "duration", str(length))
            _add(phase, "color", words[colour])
        if cycle is not None:
            _add(element, "timeOffset", str(cycle.offset))
        _add(light, "active", "true")


def _write_lanelet(root: Element, lanelet: Lanelet) -> Element:
    element = SubElement(root, "lanelet", id=str(lanelet.identity))
    for name, bound in (("leftBound", lanelet.left), ("rightBound", lanelet.right)):
        inside = SubElement(element, name)
        for x, y in bound:
            _write_point(inside, x, y)
    for name, numbers in (("predecessor", lanelet.predecessors), ("successor", lanelet.successors)):
        for number in numbers:
            SubElement(element, name, ref=str(number))
    sides = (("adjacentLeft", lanelet.adjacent_left), ("adjacentRight", lanelet.adjacent_right))
    for name, beside in sides:
        if beside is not None:
            way = "same" if beside[1] else "opposite"
            SubElement(element, name, ref=str(beside[0]), drivingDir=way)
    if lanelet.stop_line is not None:
        inside = SubElement(element, "stopLine")
        for x, y in lanelet.stop_line:
            _write_point(inside, x, y)
        _add(inside, "lineMarking", "solid")
    _add(element, "laneletType", "urban")
    return element


def _write_obstacles(root: Element, tracks: Tracks) -> None:
    along, across = tracks.along_and_across()
    # A lateral part at the level of rounding is 0. Other readers require the states of a track to
    # have the same fields, so a single sliding state gives its whole track a slip angle.
    slides = np.zeros(tracks.n_tracks, bool)
    np.logical_or.at(slides, tracks.track, np.abs(across) > 1e-9)
    slips = slides[tracks.track]
    speed = np.where(slips, np.hypot(along, across), along)
    slip = np.arctan2(across, along)
    for track, (first, end) in enumerate(zip(tracks.starts[:-1], tracks.starts[1:], strict=True)):
        element = SubElement(root, "dynamicObstacle", id=str(tracks.identity[track]))
        kind = RoadUser(int(tracks.road_user[track]))
        _add(element, "type", "unknown" if kind == RoadUser.OTHER else kind.name.lower())
        shape = SubElement(SubElement(element, "shape"), "rectangle")
        _add(shape, "length", _decimal(tracks.length[track]))
        _add(shape, "width", _decimal(tracks.width[track]))
        inside = SubElement(element, "initialState")
        trajectory = SubElement(element, "trajectory") if end > first + 1 else element
        for row in range(first, end):
            state = inside if row == first else SubElement(trajectory, "state")
            _write_point(SubElement(state, "position"), tracks.x[row], tracks.y[row])
            exact = {
                "orientation": _decimal(tracks.heading[row]),
                "time": str(tracks.frame[row]),
                "velocity": _decimal(speed[row]),
            }
            if slips[row]:
                exact["slipAngle"] = _decimal(slip[row])
            for name, text in exact.items():
                _add(SubElement(state, name), "exact", text)


def _write_point(parent: Element, x: float, y: float) -> None:
    point = SubElement(parent, "point")
    _add(point, "x", _decimal(x))
    _add(point, "y", _decimal(y))


def _decimal(value: float) -> str:
    """Return the shortest text of the same number; the format's schema has no exponents."""
    return np.format_float_positional(value, unique=True, trim="0")
