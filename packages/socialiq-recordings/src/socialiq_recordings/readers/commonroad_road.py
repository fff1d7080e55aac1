"""Roads of CommonRoad XML: lanelets, right-of-way signs, speed limits and lights."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float64

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import kind_of
from socialiq_recordings import files
from socialiq_recordings.readers import commonroad_xml as xml
from socialiq_recordings.readers.column_map import UNITS
from socialiq_recordings.readers.commonroad_xml import State, whole_number
from socialiq_recordings.road.network import Cycle, Elements, Lanelet, RoadNetwork, Sign

LONGEST_CYCLE = 1_000_000
"""Most frames of a cycle that is read: more than a day at ten frames a second."""


def road_of(path: Path) -> RoadNetwork:
    """Read the lanelets of a CommonRoad file, with or without tracks, or those of a recording.

    Raises:
        UserError: If it can't be read, or holds no lanelet.
    """
    if path.suffix.lower() == ".xml":
        draft = RoadDraft(path)
        xml.read(path, draft)
        road = draft.network()
    elif path.is_file() and kind_of(path) == files.KIND:
        road = files.load(path).road
    else:
        raise UserError(
            f"{path} is not a map: name a CommonRoad file (.xml), or a recording that has lanelets"
        )
    if not road.lanelets:
        raise UserError(f"{path} holds no lanelet: name a map that does")
    return road


class RoadDraft:
    """Builder of a road network from a file's lanelets, signs and lights, in any order."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._elements = Elements(path)
        self._signs: dict[int, tuple[Sign, float]] = {}
        self._references: dict[int, tuple[int, ...]] = {}
        self._cycles: dict[int, Cycle] = {}

    def root(self, name: str, attributes: dict[str, str]) -> None:  # noqa: ARG002
        """Refuse a file of another kind.

        Args:
            name: Name of the first element.
            attributes: Attributes of that element, which are not read here.

        Raises:
            UserError: If the element is not that of CommonRoad.
        """
        if name != "commonRoad":
            raise UserError(
                f"{self.path} is not a CommonRoad file: its first element is {one_line(name, 40)}"
            )

    def state(self, state: State) -> None:
        """Ignore a state."""

    def element(self, element: Element) -> None:
        """Add an element."""
        self.add(element)

    def add(self, element: Element) -> bool:
        """Add a child of the first element, and return whether it belongs to the road."""
        name = f"{element.tag} {one_line(element.get('id', '?'), 20)}"
        if element.tag == "lanelet":
            self._elements.add(name, functools.partial(self._lanelet, element, name))
        elif element.tag in ("trafficSign", "trafficLight"):
            add = self._add_sign if element.tag == "trafficSign" else self._add_light
            self._read_detail(None, name, lambda: add(element, name))
        else:
            return element.tag == "intersection"
        return True

    def _read_detail(self, default: Any, name: str, read: Callable[[], Any]) -> Any:
        """Return what is read of a detail of the road; if that fails, name it: the default."""
        try:
            return read()
        except Elements.UNREADABLE as error:
            self._elements.leave_out(name, error)
            return default

    def _add_sign(self, element: Element, name: str) -> None:
        identity = whole_number(element.attrib["id"])
        sign = Sign.NONE
        limit = np.inf
        for item in element.findall("trafficSignElement"):
            number = text_of(item, "trafficSignID")
            sign = max(sign, xml.SIGNS.get(number, Sign.NONE))
            if number in xml.SPEED_LIMITS:
                value = item.findtext("additionalValue") or ""
                limit = min(
                    limit, self._read_detail(np.inf, name, functools.partial(_speed, value))
                )
        self._signs[identity] = sign, limit

    def _add_light(self, element: Element, name: str) -> None:
        identity = whole_number(element.attrib["id"])
        dark = text_of(element, "active") == "false"
        self._signs[identity] = Sign.NONE if dark else Sign.LIGHT, np.inf
        cycle = (
            None if dark else self._read_detail(None, name, lambda: _cycle(element.find("cycle")))
        )
        if cycle is not None:
            self._cycles[identity] = cycle

    def network(self) -> RoadNetwork:
        """Return the road: each lanelet with the strongest of its signs and the lowest limit."""
        lanelets = {}
        for identity, lanelet in self._elements.lanelets.items():
            references = self._references[identity]
            signs = [self._signs[number] for number in references if number in self._signs]
            if signs:
                # A light takes precedence over signs, as on the road. Lights for several directions
                # of one lanelet can't be told apart by a route: none is read.
                cycles = [self._cycles[number] for number in references if number in self._cycles]
                lanelet = replace(
                    lanelet,
                    sign=max(sign for sign, _ in signs),
                    speed_limit=min(lanelet.speed_limit, *(limit for _, limit in signs)),
                    cycle=cycles[0] if cycles and cycles.count(cycles[0]) == len(cycles) else None,
                )
            lanelets[identity] = lanelet
        return self._elements.road(lanelets)

    def _lanelet(self, element: Element, name: str) -> Lanelet:
        identity = whole_number(element.attrib["id"])
        left, right = (_points(element.find(side)) for side in ("leftBound", "rightBound"))

        def detail(default: Any, read: Callable[..., Any], *arguments: Any) -> Any:
            return self._read_detail(default, name, lambda: read(*arguments))

        limit = element.findtext("speedLimit")
        lanelet = Lanelet(
            identity=identity,
            left=left,
            right=right,
            successors=detail((), _references, element, "successor"),
            predecessors=detail((), _references, element, "predecessor"),
            adjacent_left=detail(None, _beside, element.find("adjacentLeft")),
            adjacent_right=detail(None, _beside, element.find("adjacentRight")),
            speed_limit=np.inf if limit is None else detail(np.inf, _speed, limit),
            stop_line=detail(None, _stop_line, element.find("stopLine"), left, right),
        )
        if identity not in self._elements.lanelets:
            kinds = ("trafficSignRef", "trafficLightRef")
            references = (detail((), _references, element, kind) for kind in kinds)
            self._references[identity] = tuple(itertools.chain(*references))
        return lanelet


def text_of(element: Element, name: str) -> str:
    """Return the text of a child without spaces around it; "" without that child.

    Args:
        element: Element that has the child.
        name: Name of the child.
    """
    return (element.findtext(name) or "").strip()


def _references(element: Element, name: str) -> tuple[int, ...]:
    return tuple(whole_number(child.attrib["ref"]) for child in element.findall(name))


def _points(bound: Element | None) -> np.ndarray:
    if bound is None:
        raise KeyError("bound on one side")
    points = [
        (float(point.findtext("x") or ""), float(point.findtext("y") or ""))
        for point in bound.findall("point")
    ]
    return np.array(points, np.float64).reshape(-1, 2)


def _stop_line(
    element: Element | None, left: np.ndarray, right: np.ndarray
) -> Float64[np.ndarray, "2 2"] | None:
    if element is None:
        return None
    line = _points(element)
    if len(line) not in (0, 2):
        raise ValueError(f"its stop line has {len(line)} points, not two")
    # Without points it is at the lanelet's end.
    return line if len(line) else np.stack([left[-1], right[-1]])


_SPEED = re.compile(r"(\d+(?:\.\d*)?)\s*(mph|km/?h|kph|m/s)?", re.ASCII | re.IGNORECASE)


def _speed(text: str) -> float:
    """Return a speed in m/s, which is the unit where the text names none."""
    match = _SPEED.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"the speed limit is '{one_line(text, 40)}', not a number of m/s")
    unit = (match[2] or "m/s").lower()
    factors = UNITS["velocity"]
    return float(match[1]) * factors[unit if unit in factors else "km/h"]


def _beside(element: Element | None) -> tuple[int, bool] | None:
    if element is None:
        return None
    return whole_number(element.attrib["ref"]), element.attrib["drivingDir"] == "same"


def _cycle(element: Element | None) -> Cycle | None:
    """Return a light's cycle; None if it has no phase."""
    phases = [] if element is None else element.findall("cycleElement")
    if element is None or not phases:
        return None
    cycle = tuple(
        (xml.COLOURS[text_of(phase, "color")], whole_number(phase.findtext("duration") or ""))
        for phase in phases
    )
    if min(length for _, length in cycle) < 1 or sum(length for _, length in cycle) > LONGEST_CYCLE:
        raise ValueError(
            f"its phases must have a frame or more each, and {LONGEST_CYCLE:,} together at most"
        )
    return Cycle(cycle, whole_number(element.findtext("timeOffset") or "0"))
