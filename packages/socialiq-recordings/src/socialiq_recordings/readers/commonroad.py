"""Recordings in CommonRoad XML, versions 2017a to 2020a.

The format: Althoff, Koschi and Manzinger, "CommonRoad: Composable benchmarks for motion planning on
roads" (IV 2017), and its documentation at https://commonroad.in.tum.de.

Dynamic obstacles become tracks. Static obstacles are counted and left out. So is the planning
problem, which describes the start of a car that was not recorded.
"""

from __future__ import annotations

from array import array
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq_recordings.readers import commonroad_xml as words
from socialiq_recordings.readers.commonroad_road import RoadDraft
from socialiq_recordings.readers.commonroad_xml import State
from socialiq_recordings.readers.commonroad_xml import read as read_xml
from socialiq_recordings.readers.motion import differences, wrapped
from socialiq_recordings.recording import (
    FARTHEST,
    STEPS,
    Imported,
    Recording,
    Refused,
    Tracks,
    order_fault,
)

MOST_STATES = 5_000_000
"""States of a file that are read by default: 1.5 GB of memory at the peak, 300 bytes for each
(`socialiq bench recordings`). An XML file of 1 GB has two or three million."""

LICENCE = "the scenario's own: see its source, and the terms under which it was obtained"


def read_commonroad(path: Path, most_states: int = MOST_STATES) -> Imported:
    """Read a scenario as a recording. Only the order of each track's frames is checked.

    Args:
        path: The XML file.
        most_states: More than these are refused before they fill the memory.

    Raises:
        UserError: If the file is missing, not of these versions, damaged, too large, or without a
            track that can be used; the line has the file's line or the thing's number.
    """
    draft = _Draft(path, most_states)
    sha256 = read_xml(path, draft)
    return draft.imported(sha256)


class _Draft:
    """Builder of a recording. States are kept in flat arrays until the end of their obstacle."""

    def __init__(self, path: Path, most_states: int) -> None:
        self._path, self._most = path, most_states
        self._attributes: dict[str, str] = {}
        self._in_seconds = False
        self._tags = ""
        self._dt = 0.0
        self._road = RoadDraft(path)
        self._frames, self._values = array("q"), array("d")  # x, y, heading, velocity, slip
        self._fault = ""
        self._n_states = self._n_intervals = 0
        self._users: list[tuple[int, int, float, float]] = []
        self._starts = [0]
        self._seen: set[int] = set()
        self._refused: list[Refused] = []
        self._skipped: dict[str, int] = {}

    def root(self, name: str, attributes: dict[str, str]) -> None:
        if name != "commonRoad":
            raise UserError(
                f"{self._path} is not a CommonRoad file: its first element is {one_line(name, 40)}"
            )
        version = attributes.get("commonRoadVersion", "")
        if version not in words.VERSIONS:
            raise UserError(
                f"{self._path} is of CommonRoad version '{one_line(version, 40)}', not one of "
                f"{', '.join(words.VERSIONS)}: convert it with commonroad-io"
            )
        self._dt = _number(attributes.get("timeStepSize", ""))
        if not STEPS[0] <= self._dt <= STEPS[1]:
            raise UserError(
                f"{self._path}: timeStepSize is not a number of seconds from {STEPS[0]:g} to "
                f"{STEPS[1]:g}"
            )
        self._attributes = attributes
        self._in_seconds = version in words.IN_SECONDS

    def state(self, state: State) -> None:
        self._n_states += 1
        if self._n_states > self._most:
            raise UserError(
                f"{self._path} holds more than {self._most:,} states: cut it into recordings, or "
                "raise --most-states where there is memory for them (about 300 bytes each)"
            )
        try:
            if "region" in state:
                raise ValueError(f"the position is a {state['region']}, not a point")
            row = [float(state[name]) for name in ("x", "y")]  # type: ignore[arg-type]
            row += [self._value(state, name) for name in ("orientation", "velocity", "slipAngle")]
            self._frames.append(self._frame(state["time"]))
            self._values.extend(row)
        except (KeyError, TypeError, ValueError) as error:
            self._fault = self._fault or _what_is_wrong(state, error)

    def _frame(self, time: str | tuple[str, str]) -> int:
        if isinstance(time, str) and "." in time and self._in_seconds:
            frame = float(time) / self._dt
            if abs(frame - round(frame)) > 1e-3:
                raise ValueError(f"{one_line(time, 20)} s is no multiple of the step")
            return round(frame)
        if isinstance(time, tuple):
            raise ValueError("the time is an interval")
        return words.whole_number(time)

    def _value(self, state: State, name: str) -> float:
        """Return a value's number, the middle of an interval, or the default of a missing value."""
        value = state.get(name)
        if isinstance(value, str):
            return float(value)
        if isinstance(value, tuple):
            self._n_intervals += 1
            return (float(value[0]) + float(value[1])) / 2
        if name == "orientation":
            raise KeyError(name)
        return 0.0 if name == "slipAngle" else np.nan

    def thing(self, thing: Element) -> None:
        kind = thing.tag
        if kind == "obstacle":  # 2018b has the same word for both
            kind = f"{(thing.findtext('role') or '').strip()}Obstacle"
        if kind == "dynamicObstacle":
            self._track(thing)
        elif kind == "scenarioTags":
            self._tags = " ".join(tag.tag for tag in thing)
        elif not self._road.thing(thing) and kind != "location":
            self._skipped[kind] = self._skipped.get(kind, 0) + 1
        self._drop_pending()

    def _drop_pending(self) -> None:
        """Discard states that no track used."""
        count = self._starts[-1]
        del self._frames[count:]
        del self._values[5 * count :]
        self._fault = ""

    def _track(self, thing: Element) -> None:
        identity = self._identity(thing)
        try:
            kind, length, width = _kind_and_size(thing)
            first = self._starts[-1]
            frames = self._frames[first:]
            fault = self._fault or order_fault(frames)
            if fault or not len(frames):
                raise ValueError(fault or "no state: it has no initial state and no trajectory")
            if not -1 < frames[0] <= frames[-1] < 2**31:
                raise ValueError(f"frame {frames[0]} is negative or out of range")
            if not (np.abs(self._complete_velocity(first)) <= FARTHEST).all():
                raise ValueError("a value is not finite or too large")
        except ValueError as error:
            self._refused.append(Refused(str(identity), one_line(str(error))))
            return
        self._users.append((identity, kind, length, width))
        self._starts.append(len(self._frames))

    def _identity(self, thing: Element) -> int:
        try:
            identity = words.whole_number(thing.get("id", ""))
        except ValueError as error:
            raise UserError(
                f"{self._path}: an obstacle's id is '{one_line(thing.get('id', ''), 40)}', not a "
                "whole number of 64 bits"
            ) from error
        if identity in self._seen:
            raise UserError(
                f"{self._path}: two obstacles have the id {identity}: give each its own"
            )
        self._seen.add(identity)
        return identity

    def _complete_velocity(self, first: int) -> np.ndarray:
        """Return the pending track's rows; missing velocities are derived from its positions."""
        rows = np.array(self._values[5 * first :]).reshape(-1, 5)
        missing = np.isnan(rows[:, 3])
        if missing.any() and (np.abs(rows[:, :3]) <= FARTHEST).all():
            vx, vy = differences(rows[:, 0], rows[:, 1], self._dt)
            along = vx * np.cos(rows[:, 2]) + vy * np.sin(rows[:, 2])
            rows[:, 3] = np.where(missing, along, rows[:, 3])
            self._values[5 * first :] = array("d", rows.ravel())
        return rows

    def imported(self, sha256: str) -> Imported:
        if not self._users:
            first = (
                f": {self._refused[0].identity}: {self._refused[0].reason}" if self._refused else ""
            )
            raise UserError(
                f"{self._path} has no dynamic obstacle that can be used, so no track{first}"
            )
        users = np.array(self._users, np.float64)
        rows = np.frombuffer(self._values).reshape(-1, 5)
        heading, direction = wrapped(rows[:, 2]), rows[:, 2] + rows[:, 4]
        tracks = Tracks(
            track=np.repeat(np.arange(len(users), dtype=np.int32), np.diff(self._starts)),
            frame=np.frombuffer(self._frames, np.int64).astype(np.int32),
            x=rows[:, 0].copy(),
            y=rows[:, 1].copy(),
            heading=heading,
            vx=rows[:, 3] * np.cos(direction),
            vy=rows[:, 3] * np.sin(direction),
            identity=np.array([user[0] for user in self._users], np.int64),
            road_user=users[:, 1].astype(np.int8),
            length=users[:, 2].copy(),
            width=users[:, 3].copy(),
            dt=self._dt,
            recording=one_line(self._attributes.get("benchmarkID", "")) or self._path.stem,
            source=self._source(sha256),
        )
        return Imported(
            Recording(tracks, self._road.network()),
            tuple(self._refused),
            dict(self._skipped),
            self._n_states,
        )

    def _source(self, sha256: str) -> dict[str, object]:
        names = ("commonRoadVersion", "source", "author", "affiliation", "date")
        return {
            "format": "commonroad",
            "file": self._path.name,
            "sha256": sha256,
            "licence": LICENCE,
            "intervals": self._n_intervals,
            **{name: one_line(self._attributes.get(name, "")) for name in names},
            "tags": one_line(self._tags or self._attributes.get("tags", "")),
        }


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _kind_and_size(thing: Element) -> tuple[int, float, float]:
    """Return class, length and width of an obstacle.

    Raises:
        ValueError: If it has no rectangle or circle around its position.
    """
    name = (thing.findtext("type") or "").strip()
    if name not in words.TYPES:
        raise ValueError(f"type '{one_line(name, 40)}' is not among {', '.join(words.TYPES)}")
    kind = int(words.TYPES[name])
    shapes = list(thing.find("shape") or [])  # type: ignore[arg-type]
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
    return kind, length, width


def _what_is_wrong(state: State, error: Exception) -> str:
    time = state.get("time")
    when = f"state of time {one_line(time, 20)}" if isinstance(time, str) else "a state"
    if isinstance(time, tuple):
        return "a state's time is an interval"
    if isinstance(error, KeyError):
        return f"{when}: no {error.args[0]}"
    return f"{when}: {error}"
