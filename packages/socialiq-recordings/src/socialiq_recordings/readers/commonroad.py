"""Recordings and roads in CommonRoad XML, versions 2017a to 2020a.

The format: Althoff, Koschi and Manzinger, "CommonRoad: Composable benchmarks for motion planning on
roads" (IV 2017), and its documentation at https://commonroad.in.tum.de.

Dynamic obstacles become tracks. Static obstacles are counted and left out. So is the planning
problem, which describes the start of a car that was not recorded.
"""

from __future__ import annotations

from array import array
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.physics import wrapped_heading
from socialiq.storage import kind_of
from socialiq_recordings import files
from socialiq_recordings.readers import commonroad_xml as xml
from socialiq_recordings.readers import tracks
from socialiq_recordings.readers.commonroad_xml import State, whole_number
from socialiq_recordings.recording import FARTHEST, Imported
from socialiq_recordings.road.network import Cycle, Lanelet, RoadNetwork, Sign

LICENCE = "the scenario's own: see its source, and the terms under which it was obtained"

LONGEST_CYCLE = 1_000_000
"""Most frames of a cycle that is read: more than a day at ten frames a second."""


def read_commonroad(path: Path, most_states: int = tracks.MOST_STATES) -> Imported:
    """Read a scenario as a recording. Only the order of each track's frames is checked.

    Raises:
        UserError: If the file is missing, not of these versions, damaged, without a track that can
            be used, or has more than `most_states`; the line has the file's line or the element's
            number.
    """
    draft = _Draft(path, most_states)
    return draft.imported(xml.read(path, draft))


def road_of(path: Path) -> RoadNetwork:
    """Read the lanelets of a CommonRoad file, with or without tracks, or those of a recording.

    Raises:
        UserError: If it can't be read, or holds no lanelet.
    """
    if path.suffix.lower() == ".xml":
        draft = _RoadDraft(path)
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


class _RoadDraft:
    """Builder of a road network from a file's lanelets, signs and lights, in any order."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lanelets: dict[int, Lanelet] = {}
        self._signs: dict[int, tuple[Sign, float]] = {}
        self._references: dict[int, tuple[int, ...]] = {}
        self._cycles: dict[int, Cycle] = {}

    def root(self, name: str, attributes: dict[str, str]) -> None:  # noqa: ARG002
        if name != "commonRoad":
            raise UserError(
                f"{self._path} is not a CommonRoad file: its first element is {one_line(name, 40)}"
            )

    def state(self, state: State) -> None:
        """Ignore a state."""

    def element(self, element: Element) -> None:
        self.add(element)

    def add(self, element: Element) -> bool:
        """Add a child of the first element, and return whether it belongs to the road."""
        try:
            if element.tag == "lanelet":
                self._add_lanelet(element)
            elif element.tag == "trafficSign":
                sign, limit = Sign.NONE, np.inf
                for item in element.findall("trafficSignElement"):
                    number = _text(item, "trafficSignID")
                    sign = max(sign, xml.SIGNS.get(number, Sign.NONE))
                    if number in xml.SPEED_LIMITS:
                        limit = min(limit, float(item.findtext("additionalValue") or ""))
                self._signs[whole_number(element.attrib["id"])] = sign, limit
            elif element.tag == "trafficLight":
                dark = _text(element, "active") == "false"
                identity = whole_number(element.attrib["id"])
                self._signs[identity] = Sign.NONE if dark else Sign.LIGHT, np.inf
                cycle = None if dark else _cycle(element.find("cycle"))
                if cycle is not None:
                    self._cycles[identity] = cycle
            else:
                return element.tag == "intersection"
        except (KeyError, ValueError, TypeError, UserError) as error:
            number = one_line(element.get("id", "?"), 20)
            text = f"no {error}" if isinstance(error, KeyError) else one_line(str(error))
            where = f"{element.tag} {number}: "  # which a lanelet's own errors name already
            raise UserError(f"{self._path}: {where}{text.removeprefix(where)}") from error
        return True

    def network(self) -> RoadNetwork:
        """Return the road: each lanelet with the strongest of its signs and the lowest limit."""
        lanelets = {}
        for identity, lanelet in self._lanelets.items():
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
        return RoadNetwork(lanelets)

    def _add_lanelet(self, element: Element) -> None:
        identity = whole_number(element.attrib["id"])
        if identity in self._lanelets:
            raise ValueError("two lanelets have this id: give each its own")
        left, right = (_points(element.find(name)) for name in ("leftBound", "rightBound"))
        limit, stop, line = element.findtext("speedLimit"), element.find("stopLine"), None
        if stop is not None:
            line = _points(stop)
            if len(line) not in (0, 2):
                raise ValueError(f"its stop line has {len(line)} points, not two")
            # Without points it is at the lanelet's end.
            line = line if len(line) else np.stack([left[-1], right[-1]])
        self._lanelets[identity] = Lanelet(
            identity=identity,
            left=left,
            right=right,
            successors=_references(element, "successor"),
            predecessors=_references(element, "predecessor"),
            adjacent_left=_beside(element.find("adjacentLeft")),
            adjacent_right=_beside(element.find("adjacentRight")),
            speed_limit=np.inf if limit is None else float(limit),
            stop_line=line,
        )
        signs, lights = (_references(element, f"traffic{kind}Ref") for kind in ("Sign", "Light"))
        self._references[identity] = (*signs, *lights)


def _text(element: Element, name: str) -> str:
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
        (xml.COLOURS[_text(phase, "color")], whole_number(phase.findtext("duration") or ""))
        for phase in phases
    )
    if min(length for _, length in cycle) < 1 or sum(length for _, length in cycle) > LONGEST_CYCLE:
        raise ValueError(
            f"its phases must have a frame or more each, and {LONGEST_CYCLE:,} together at most"
        )
    return Cycle(cycle, whole_number(element.findtext("timeOffset") or "0"))


class _Draft(_RoadDraft):
    """Builder of a recording. States are kept in flat arrays until the end of their obstacle."""

    def __init__(self, path: Path, most_states: int) -> None:
        super().__init__(path)
        self._most, self._gathered = most_states, tracks.Gathered(path)
        self._attributes: dict[str, str] = {}
        self._in_seconds, self._tags, self._dt, self._n_intervals = False, "", 0.0, 0
        self._frames, self._values = array("q"), array("d")  # x, y, heading, velocity, slip
        self._fault = ""
        self._identities: set[int] = set()

    def root(self, name: str, attributes: dict[str, str]) -> None:
        super().root(name, attributes)
        version = attributes.get("commonRoadVersion", "")
        if version not in xml.VERSIONS:
            raise UserError(
                f"{self._path} is of CommonRoad version '{one_line(version, 40)}', not one of "
                f"{', '.join(xml.VERSIONS)}: convert it with commonroad-io"
            )
        self._dt = _number(attributes.get("timeStepSize", ""))
        low, high = tracks.STEPS
        if not low <= self._dt <= high:
            raise UserError(
                f"{self._path}: timeStepSize is not a number of seconds from {low:g} to {high:g}"
            )
        self._attributes = attributes
        self._in_seconds = version in xml.IN_SECONDS

    def state(self, state: State) -> None:
        self._gathered.n_states += 1
        if self._gathered.n_states > self._most:
            raise UserError(
                f"{self._path} holds more than {self._most:,} states: cut it into recordings, or "
                "raise --most-states where there is memory for them (about 300 bytes each)"
            )
        try:
            if "region" in state:
                raise ValueError(f"the position is a {state['region']}, not a point")
            row = [float(state[name]) for name in ("x", "y")]  # type: ignore[arg-type]
            row += [self._value(state, name) for name in ("orientation", "velocity", "slipAngle")]
            time = state["time"]
            if isinstance(time, tuple):
                raise ValueError("the time is an interval")
            if "." in time and self._in_seconds:
                frame = float(time) / self._dt
                if abs(frame - round(frame)) > 1e-3:
                    raise ValueError(f"{one_line(time, 20)} s is no multiple of the step")
                self._frames.append(round(frame))
            else:
                self._frames.append(whole_number(time))
            self._values.extend(row)
        except (KeyError, TypeError, ValueError) as error:
            time = state.get("time")
            name = f"state of time {one_line(time, 20)}" if isinstance(time, str) else "a state"
            fault = f"no {error.args[0]}" if isinstance(error, KeyError) else str(error)
            self._fault = self._fault or f"{name}: {fault}"

    def _value(self, state: State, name: str) -> float:
        """Return a value's number, the middle of an interval, or the default of a missing value."""
        value = state[name] if name == "orientation" else state.get(name)
        if isinstance(value, str):
            return float(value)
        if isinstance(value, tuple):
            self._n_intervals += 1
            return (float(value[0]) + float(value[1])) / 2
        return 0.0 if name == "slipAngle" else np.nan

    def element(self, element: Element) -> None:
        kind = element.tag
        if kind == "obstacle":  # 2018b has the same word for both
            kind = f"{_text(element, 'role')}Obstacle"
        if kind == "dynamicObstacle":
            try:
                self._add_track(element)
            except ValueError as error:
                self._gathered.refuse(element.get("id", "?"), error)
        elif kind == "scenarioTags":
            self._tags = " ".join(tag.tag for tag in element)
        elif not self.add(element) and kind != "location":
            self._gathered.skipped[kind] = self._gathered.skipped.get(kind, 0) + 1
        self._frames, self._values, self._fault = array("q"), array("d"), ""

    def _add_track(self, element: Element) -> None:
        try:
            identity = whole_number(element.get("id", ""))
        except ValueError as error:
            raise ValueError("its id is not a whole number of 64 bits") from error
        if identity in self._identities:
            raise ValueError("two obstacles have this id: give each its own")
        self._identities.add(identity)
        user = _kind_and_size(element)
        if self._fault or not self._frames:
            raise ValueError(self._fault or "no state: it has no initial state and no trajectory")
        frames = np.array(self._frames, np.int64)
        tracks.check_frames(frames)
        rows = np.array(self._values).reshape(-1, 5)
        missing = np.isnan(rows[:, 3])
        if missing.any() and (np.abs(rows[:, :3]) <= FARTHEST).all():
            vx, vy = tracks.differences(rows[:, 0], rows[:, 1], self._dt)
            along = vx * np.cos(rows[:, 2]) + vy * np.sin(rows[:, 2])
            rows[:, 3] = np.where(missing, along, rows[:, 3])
        largest = np.abs(rows).max(axis=1)
        tracks.check_numbers("a value", largest, lambda row: f"state of time {frames[row]}: ")
        direction = rows[:, 2] + rows[:, 4]
        velocity = rows[:, 3] * np.cos(direction), rows[:, 3] * np.sin(direction)
        states = np.stack([rows[:, 0], rows[:, 1], wrapped_heading(rows[:, 2]), *velocity])
        self._gathered.add(identity, user, frames, states)

    def imported(self, sha256: str) -> Imported:
        names = ("commonRoadVersion", "source", "author", "affiliation", "date")
        source = {
            "format": "commonroad",
            "file": self._path.name,
            "sha256": sha256,
            "licence": LICENCE,
            "intervals": self._n_intervals,
            **{name: one_line(self._attributes.get(name, "")) for name in names},
            "tags": one_line(self._tags or self._attributes.get("tags", "")),
        }
        name = one_line(self._attributes.get("benchmarkID", "")) or self._path.stem
        return self._gathered.imported(name, self._dt, source, self.network())


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _kind_and_size(element: Element) -> tracks.User:
    """Return class, length and width of an obstacle.

    Raises:
        ValueError: If it has no rectangle or circle around its position.
    """
    name = _text(element, "type")
    if name not in xml.TYPES:
        raise ValueError(f"type '{one_line(name, 40)}' is not among {', '.join(xml.TYPES)}")
    shapes = list(element.find("shape") or [])  # type: ignore[arg-type]
    if len(shapes) != 1 or shapes[0].tag not in ("rectangle", "circle"):
        names = ", ".join(shape.tag for shape in shapes) or "missing"
        raise ValueError(
            f"its shape is {one_line(names, 40)}: only one rectangle or circle is read"
        )
    shape = shapes[0]
    if shape.tag == "circle":
        # A circle is represented by the square around it.
        length = width = 2 * _number(shape.findtext("radius") or "")
    else:
        length, width = (_number(shape.findtext(side) or "") for side in ("length", "width"))
    moved = ("originXShift", "orientation", "center/x", "center/y")
    if any(_number(shape.findtext(name) or "0") != 0 for name in moved):
        raise ValueError("its rectangle does not lie around its position, along its heading")
    if not (0 < length < np.inf and 0 < width < np.inf):
        raise ValueError("its length or width is not a number of metres above 0")
    return int(xml.TYPES[name]), length, width
