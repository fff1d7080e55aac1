"""Recordings and roads in CommonRoad XML, versions 2017a to 2020a.

The format: Althoff, Koschi and Manzinger, "CommonRoad: Composable benchmarks for motion planning on
roads" (IV 2017), and its documentation at https://commonroad.in.tum.de.

Dynamic obstacles become tracks. Static obstacles are counted and left out. So is the planning
problem, which describes the start of a car that was not recorded.
"""

from array import array
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.physics import wrapped_heading
from socialiq_recordings.readers import commonroad_xml as xml
from socialiq_recordings.readers import tracks
from socialiq_recordings.readers.commonroad_road import RoadDraft, text_of
from socialiq_recordings.readers.commonroad_xml import State, whole_number
from socialiq_recordings.recording import FARTHEST, Imported, RoadUser

LICENCE = "the scenario's own: see its source, and the terms under which it was obtained"


def read_commonroad(path: Path, most_states: int = tracks.MOST_STATES) -> Imported:
    """Read a scenario as a recording. Only the order of each track's frames is checked.

    Raises:
        UserError: If the file is missing, not of these versions, damaged, without a track that can
            be used, or has more than `most_states`; the line has the file's line or the element's
            number.
    """
    draft = _Draft(path, most_states)
    return draft.imported(xml.read(path, draft))


class _Draft(RoadDraft):
    """Builder of a recording. States are kept in flat arrays until the end of their obstacle."""

    def __init__(self, path: Path, most_states: int) -> None:
        super().__init__(path)
        self._most = most_states
        self._gathered = tracks.Gathered(path)
        self._attributes: dict[str, str] = {}
        self._in_seconds = False
        self._tags = ""
        self._dt = 0.0
        self._n_intervals = 0
        self._frames = array("q")
        self._values = array("d")  # x, y, heading, velocity, slip and vy of each frame
        self._fault = ""
        self._identities: set[int] = set()

    def root(self, name: str, attributes: dict[str, str]) -> None:
        super().root(name, attributes)
        version = attributes.get("commonRoadVersion", "")
        if version not in xml.VERSIONS:
            raise UserError(
                f"{self.path} is of CommonRoad version '{one_line(version, 40)}', not one of "
                f"{', '.join(xml.VERSIONS)}: convert it with commonroad-io"
            )
        self._dt = _number(attributes.get("timeStepSize", ""))
        low, high = tracks.STEPS
        if not low <= self._dt <= high:
            raise UserError(
                f"{self.path}: timeStepSize is not a number of seconds from {low:g} to {high:g}"
            )
        self._attributes = attributes
        self._in_seconds = version in xml.IN_SECONDS

    def state(self, state: State) -> None:
        self._gathered.n_states += 1
        if self._gathered.n_states > self._most:
            raise UserError(
                f"{self.path} holds more than {self._most:,} states: cut it into recordings, or "
                "raise --most-states where there is memory for them (about 300 bytes each)"
            )
        try:
            if "region" in state:
                raise ValueError(f"the position is a {state['region']}, not a point")
            row = [float(state[name]) for name in ("x", "y")]  # type: ignore[arg-type]
            names = ("orientation", "velocity", "slipAngle", "velocityY")
            row += [self._value(state, name) for name in names]
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
        needed = name == "orientation" and "velocityY" not in state  # of a point mass
        value = state[name] if needed else state.get(name)
        if isinstance(value, str):
            return float(value)
        if isinstance(value, tuple):
            self._n_intervals += 1
            return (float(value[0]) + float(value[1])) / 2
        return 0.0 if name == "slipAngle" else np.nan

    def element(self, element: Element) -> None:
        kind = element.tag
        if kind == "obstacle":  # 2018b has the same word for both
            kind = f"{text_of(element, 'role')}Obstacle"
        if kind == "dynamicObstacle":
            try:
                self._add_track(element)
            except ValueError as error:
                kind_of = xml.TYPES.get(text_of(element, "type"))
                self._gathered.refuse(element.get("id", "?"), error, kind_of)
        elif kind == "scenarioTags":
            self._tags = " ".join(tag.tag for tag in element)
        elif not self.add(element) and kind != "location":
            self._gathered.note(kind)
        self._frames = array("q")
        self._values = array("d")
        self._fault = ""

    def _add_track(self, element: Element) -> None:
        try:
            identity = whole_number(element.get("id", ""))
        except ValueError as error:
            raise ValueError("its id is not a whole number of 64 bits") from error
        if identity in self._identities:
            raise ValueError("two obstacles have this id: give each its own")
        self._identities.add(identity)
        name = text_of(element, "type")
        user = (int(xml.TYPES.get(name, RoadUser.OTHER)), *_size(element))
        if element.find("occupancySet") is not None:
            raise ValueError("its prediction is a set of regions, not a trajectory")
        if self._fault or not self._frames:
            raise ValueError(self._fault or "no state: it has no initial state and no trajectory")
        frames = np.array(self._frames, np.int64)
        rows = np.array(self._values).reshape(-1, 6)
        again = tracks.repeated(frames, rows.T)
        self._gathered.note("repeated state", int(again.sum()))
        frames = frames[~again]
        rows = rows[~again]
        tracks.check_frames(frames)
        if np.isnan(rows[:, 2]).any():
            mass = np.isnan(rows[:, 2])
            vx, vy = (
                np.where(mass, rows[:, column], rows[:, 3] * turn(rows[:, 2]))
                for column, turn in ((3, np.cos), (5, np.sin))
            )
            heading = tracks.heading_of_motion(np.nan_to_num(vx), np.nan_to_num(vy))
            if heading is None and mass.all():
                raise ValueError("it never moves, and states of a point mass have no orientation")
            stated = rows[~mass][:1, 2]  # of one that stands, like the initial state
            heading = np.full(len(rows), stated[0]) if heading is None else heading
            rows = rows.copy()
            rows[mass, 2] = heading[mass]
            rows[mass, 3] = np.hypot(vx, vy)[mass]
            rows[mass, 4] = (np.arctan2(vy, vx) - heading)[mass]
        missing = np.isnan(rows[:, 3])
        if missing.any() and (np.abs(rows[:, :3]) <= FARTHEST).all():
            vx, vy = tracks.differences(rows[:, 0], rows[:, 1], self._dt)
            along = vx * np.cos(rows[:, 2]) + vy * np.sin(rows[:, 2])
            rows[:, 3] = np.where(missing, along, rows[:, 3])
        largest = np.abs(rows[:, :5]).max(axis=1)
        tracks.check_numbers("a value", largest, lambda row: f"state of time {frames[row]}: ")
        direction = rows[:, 2] + rows[:, 4]
        velocity = rows[:, 3] * np.cos(direction), rows[:, 3] * np.sin(direction)
        states = np.stack([rows[:, 0], rows[:, 1], wrapped_heading(rows[:, 2]), *velocity])
        if name not in xml.TYPES:
            known = ", ".join(xml.TYPES)
            reason = f"type '{one_line(name, 40)}' is not among {known}"
            self._gathered.unknown(identity, reason)
        self._gathered.add(identity, user, frames, states)

    def imported(self, sha256: str) -> Imported:
        names = ("commonRoadVersion", "source", "author", "affiliation", "date")
        source = {
            "format": "commonroad",
            "file": self.path.name,
            "sha256": sha256,
            "licence": LICENCE,
            "intervals": self._n_intervals,
            **{name: one_line(self._attributes.get(name, "")) for name in names},
            "tags": one_line(self._tags or self._attributes.get("tags", "")),
        }
        name = one_line(self._attributes.get("benchmarkID", "")) or self.path.stem
        return self._gathered.imported(name, self._dt, source, self.network())


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _size(element: Element) -> tuple[float, float]:
    """Return length and width of an obstacle."""
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
    return length, width
