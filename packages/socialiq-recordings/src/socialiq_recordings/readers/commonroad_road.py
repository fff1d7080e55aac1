"""Road network of a CommonRoad file: lanelets with their signs and lights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import kind_of
from socialiq_recordings import files
from socialiq_recordings.readers.commonroad_xml import (
    COLOURS,
    SIGNS,
    SPEED_LIMITS,
    State,
    read,
    whole_number,
)
from socialiq_recordings.road.network import Cycle, Lanelet, RoadNetwork, Sign

_IGNORED = ("intersection",)

LONGEST_CYCLE = 1_000_000
"""Most frames of a cycle that is read: more than a day at ten frames a second."""


class RoadDraft:
    """Builder of a road network from a file's lanelets, signs and lights, in any order.

    Args:
        path: The file, for error messages.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lanelets: dict[int, Lanelet] = {}
        self._signs: dict[int, tuple[Sign, float]] = {}
        self._named: dict[int, list[int]] = {}
        self._cycles: dict[int, Cycle] = {}

    def thing(self, thing: Element) -> bool:
        """Add a child of the first element, if it belongs to the road.

        Raises:
            UserError: If it can't be read; the line has its number.
        """
        try:
            if thing.tag == "lanelet":
                self._lanelet(thing)
            elif thing.tag == "trafficSign":
                self._signs[whole_number(thing.attrib["id"])] = _sign(thing)
            elif thing.tag == "trafficLight":
                dark = (thing.findtext("active") or "").strip() == "false"
                signs = Sign.NONE if dark else Sign.LIGHT
                identity = whole_number(thing.attrib["id"])
                self._signs[identity] = signs, np.inf
                cycle = None if dark else _cycle(thing.find("cycle"))
                if cycle is not None:
                    self._cycles[identity] = cycle
            else:
                return thing.tag in _IGNORED
        except (KeyError, ValueError, TypeError, UserError) as error:
            number = one_line(thing.get("id", "?"), 20)
            text = f"no {error}" if isinstance(error, KeyError) else one_line(str(error))
            where = f"{thing.tag} {number}: "  # which a lanelet's own errors name already
            raise UserError(f"{self._path}: {where}{text.removeprefix(where)}") from error
        return True

    def network(self) -> RoadNetwork:
        """Return the road: each lanelet with the strongest of its signs and the lowest limit."""
        return RoadNetwork(
            {identity: self._with_signs(lanelet) for identity, lanelet in self._lanelets.items()}
        )

    def _with_signs(self, lanelet: Lanelet) -> Lanelet:
        references = self._named[lanelet.identity]
        signs = [self._signs[number] for number in references if number in self._signs]
        if not signs:
            return lanelet
        # A light takes precedence over signs, as on the road.
        sign = max(sign_of for sign_of, _ in signs)
        limit = min(lanelet.speed_limit, *(limit for _, limit in signs))
        cycles = [self._cycles[number] for number in references if number in self._cycles]
        # Lights for several directions of one lanelet can't be told apart by a route: none is read.
        cycle = cycles[0] if cycles and all(cycle_of == cycles[0] for cycle_of in cycles) else None
        return replace(lanelet, sign=sign, speed_limit=limit, cycle=cycle)

    def _lanelet(self, thing: Element) -> None:
        identity = whole_number(thing.attrib["id"])
        if identity in self._lanelets:
            raise ValueError("two lanelets have this id: give each its own")
        left, right = (_points(thing.find(name)) for name in ("leftBound", "rightBound"))
        limit = thing.findtext("speedLimit")
        self._lanelets[identity] = Lanelet(
            identity=identity,
            left=left,
            right=right,
            successors=_references(thing, "successor"),
            predecessors=_references(thing, "predecessor"),
            adjacent_left=_beside(thing.find("adjacentLeft")),
            adjacent_right=_beside(thing.find("adjacentRight")),
            speed_limit=np.inf if limit is None else float(limit),
            stop_line=_stop_line(thing.find("stopLine"), left, right),
        )
        references = [*_references(thing, "trafficSignRef"), *_references(thing, "trafficLightRef")]
        self._named[identity] = references


def _references(thing: Element, name: str) -> tuple[int, ...]:
    return tuple(whole_number(element.attrib["ref"]) for element in thing.findall(name))


def _points(bound: Element | None) -> np.ndarray:
    if bound is None:
        raise KeyError("bound on one side")
    points = [
        (float(point.findtext("x") or ""), float(point.findtext("y") or ""))
        for point in bound.findall("point")
    ]
    return np.array(points, np.float64).reshape(-1, 2)


def _beside(element: Element | None) -> tuple[int, bool] | None:
    if element is None:
        return None
    return whole_number(element.attrib["ref"]), element.attrib["drivingDir"] == "same"


def _stop_line(element: Element | None, left: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Return two points; a stop line without points is at the lanelet's end."""
    if element is None:
        return None
    points = _points(element)
    if len(points) not in (0, 2):
        raise ValueError(f"its stop line has {len(points)} points, not two")
    return points if len(points) else np.stack([left[-1], right[-1]])


def _cycle(element: Element | None) -> Cycle | None:
    """Return a light's cycle; None if it has no phase."""
    phases = [] if element is None else element.findall("cycleElement")
    if element is None or not phases:
        return None
    cycle = tuple(
        (
            COLOURS[(element_of.findtext("color") or "").strip()],
            whole_number(element_of.findtext("duration") or ""),
        )
        for element_of in phases
    )
    if min(length for _, length in cycle) < 1 or sum(length for _, length in cycle) > LONGEST_CYCLE:
        raise ValueError(
            f"its phases must have a frame or more each, and {LONGEST_CYCLE:,} together at most"
        )
    return Cycle(cycle, whole_number(element.findtext("timeOffset") or "0"))


def _sign(thing: Element) -> tuple[Sign, float]:
    """Return a sign's right of way, and its speed limit in m/s."""
    sign, limit = Sign.NONE, np.inf
    for element in thing.findall("trafficSignElement"):
        number = (element.findtext("trafficSignID") or "").strip()
        sign = max(sign, SIGNS.get(number, Sign.NONE))
        if number in SPEED_LIMITS:
            limit = min(limit, float(element.findtext("additionalValue") or ""))
    return sign, limit


class _RoadAlone:
    """Consumer that keeps the lanelets of a file and ignores everything else."""

    def __init__(self, path: Path) -> None:
        self._path, self.draft = path, RoadDraft(path)

    def root(self, name: str, attributes: dict[str, str]) -> None:  # noqa: ARG002
        if name != "commonRoad":
            raise UserError(
                f"{self._path} is not a CommonRoad file: its first element is {one_line(name, 40)}"
            )

    def state(self, state: State) -> None:
        """Ignore a state."""

    def thing(self, thing: Element) -> None:
        self.draft.thing(thing)


def road_of(path: Path) -> RoadNetwork:
    """Read the lanelets of a CommonRoad file, or those of a recording.

    Args:
        path: XML, with or without tracks, or a file of `socialiq data import`.

    Raises:
        UserError: If it can't be read, or holds no lanelet.
    """
    if path.suffix.lower() == ".xml":
        gathered = _RoadAlone(path)
        read(path, gathered)
        road = gathered.draft.network()
    elif path.is_file() and kind_of(path) == files.KIND:
        road = files.load(path).road
    else:
        raise UserError(
            f"{path} is not a map: name a CommonRoad file (.xml), or a recording that has lanelets"
        )
    if not road.lanelets:
        raise UserError(f"{path} holds no lanelet: name a map that does")
    return road
