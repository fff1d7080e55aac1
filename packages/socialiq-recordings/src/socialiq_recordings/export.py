"""Export of tracks: CSV in three layouts, CommonRoad XML 2020a.

Numbers are written with full precision. The layouts' own units and reference points are used
(degrees, feet, front centres), whose conversion changes the last bits of some numbers.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping
from itertools import count
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.storage import write_atomically
from socialiq_recordings.readers import commonroad_xml as xml
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Cycle, Lanelet, RoadNetwork, Sign

FOOT = 0.3048  # length of a foot in m, exact by definition
_NGSIM_CLASSES = {RoadUser.MOTORCYCLE: 1, RoadUser.CAR: 2, RoadUser.TRUCK: 3, RoadUser.BUS: 3}
_INTERACTION_CLASSES = {RoadUser.PEDESTRIAN: "pedestrian/bicycle", RoadUser.BICYCLE: "bicycle"}
_SIGN_NUMBERS = {Sign.PRIORITY: "306", Sign.YIELD: "205", Sign.STOP: "206"}
_SPEED_LIMIT = "274"

_Columns = Mapping[str, Iterable[object]]


def write_csv(tracks: Tracks, layout: str, folder: Path) -> Path:
    """Write tracks as the files of a data set; the column map of the same name reads them.

    Layouts: `ind` (three files), `interaction` and `ngsim` (10 Hz only; ngsim has no heading, no
    pedestrians and no bicycles, and calls a bus a truck). The folder must exist.

    Returns:
        The file with the states, the argument of an import.

    Raises:
        UserError: If the layout can't hold the tracks, or a file can't be written.
    """
    one_of("layout", layout, tuple(_LAYOUTS))
    name = "".join(
        character if character.isalnum() or character in "-._" else "-"
        for character in tracks.recording
    )
    if layout != "ind" and abs(tracks.dt - 0.1) > 1e-9:
        raise UserError(f"the {layout} layout has 10 frames a second, not {1 / tracks.dt:g}")
    files = _LAYOUTS[layout](tracks, [RoadUser(int(kind)) for kind in tracks.road_user])
    paths = [folder / pattern.format(name) for pattern in files]
    for path, columns in zip(paths, files.values(), strict=True):
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        lists = (c.tolist() if isinstance(c, np.ndarray) else c for c in columns.values())
        writer.writerows(zip(*lists, strict=True))
        write_atomically(path, text.getvalue())
    return paths[0]


def _ind(tracks: Tracks, kinds: list[RoadUser]) -> dict[str, _Columns]:
    starts, track = tracks.starts, tracks.track
    first, last = tracks.frame[starts[:-1]], tracks.frame[starts[1:] - 1]
    words = ["trailer" if kind == RoadUser.OTHER else kind.name.lower() for kind in kinds]
    states = {
        "recordingId": [0] * tracks.n_states,
        "trackId": tracks.identity[track],
        "frame": tracks.frame,
        "trackLifetime": np.arange(tracks.n_states) - starts[track],
        "xCenter": tracks.x,
        "yCenter": tracks.y,
        "heading": np.degrees(tracks.heading) % 360,
        "width": tracks.width[track],
        "length": tracks.length[track],
        "xVelocity": tracks.vx,
        "yVelocity": tracks.vy,
    }
    users = {
        "recordingId": [0] * tracks.n_tracks,
        "trackId": tracks.identity,
        "initialFrame": first,
        "finalFrame": last,
        "numFrames": last - first + 1,
        "width": tracks.width,
        "length": tracks.length,
        "class": words,
    }
    rate = {"recordingId": [0], "frameRate": [1 / tracks.dt]}
    names = "{}_tracks.csv", "{}_tracksMeta.csv", "{}_recordingMeta.csv"
    return dict(zip(names, (states, users, rate), strict=True))


def _interaction(tracks: Tracks, kinds: list[RoadUser]) -> dict[str, _Columns]:
    words = [_INTERACTION_CLASSES.get(kind, kind.name.lower()) for kind in kinds]
    states = {
        "track_id": tracks.identity[tracks.track],
        "frame_id": tracks.frame,
        "timestamp_ms": tracks.frame.astype(np.int64) * 100,
        "agent_type": [words[number] for number in tracks.track],
        "x": tracks.x,
        "y": tracks.y,
        "vx": tracks.vx,
        "vy": tracks.vy,
        "psi_rad": tracks.heading,
        "length": tracks.length[tracks.track],
        "width": tracks.width[tracks.track],
    }
    return {"vehicle_tracks_{}.csv": states}


def _ngsim(tracks: Tracks, kinds: list[RoadUser]) -> dict[str, _Columns]:
    absent = next((kind for kind in kinds if kind not in _NGSIM_CLASSES), None)
    if absent is not None:
        raise UserError(f"the ngsim layout has no class for {absent.name}: leave such tracks out")
    track, half = tracks.track, tracks.length[tracks.track] / 2
    states = {
        "Vehicle_ID": tracks.identity[track],
        "Frame_ID": tracks.frame,
        "Total_Frames": np.diff(tracks.starts)[track],
        "Global_Time": tracks.frame.astype(np.int64) * 100,
        "Local_X": (tracks.x + half * np.cos(tracks.heading)) / FOOT,
        "Local_Y": (tracks.y + half * np.sin(tracks.heading)) / FOOT,
        "v_Length": tracks.length[track] / FOOT,
        "v_Width": tracks.width[track] / FOOT,
        "v_Vel": np.hypot(tracks.vx, tracks.vy) / FOOT,
        "v_Class": [_NGSIM_CLASSES[kinds[number]] for number in track],
        "Location": [tracks.recording] * tracks.n_states,
    }
    return {"{}.csv": states}


_LAYOUTS: dict[str, Callable[[Tracks, list[RoadUser]], dict[str, _Columns]]] = {
    "ind": _ind,
    "interaction": _interaction,
    "ngsim": _ngsim,
}


def write_commonroad(recording: Recording, path: Path) -> None:
    """Write a recording as CommonRoad XML 2020a.

    A velocity that is not along the heading is written with a slip angle. Signs get the numbers
    of the format's fictitious country ZAM. The recording's name becomes the benchmark's; other
    readers require a name such as `ZAM_Cross-1_1_T-1`.

    Raises:
        UserError: If two elements have the same number, or the file can't be written.
    """
    tracks, road = recording.tracks, recording.road
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
