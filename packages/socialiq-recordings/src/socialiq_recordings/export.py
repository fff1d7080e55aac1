"""Export of tracks: CSV in three layouts, CommonRoad XML 2020a.

Numbers are written with full precision. The layouts' own units and reference points are used
(degrees, feet, front centres), whose conversion changes the last bits of some numbers.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable
from itertools import count
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.storage import write_atomically
from socialiq_recordings.readers import commonroad_xml as words
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Cycle, Lanelet, RoadNetwork

FOOT = 0.3048
"""Length of a foot in m, exact by definition."""

_TEN_HERTZ = 0.1

_NGSIM_CLASSES = {
    RoadUser.MOTORCYCLE: 1,
    RoadUser.CAR: 2,
    RoadUser.TRUCK: 3,
    RoadUser.BUS: 3,
}

_INTERACTION_CLASSES = {RoadUser.PEDESTRIAN: "pedestrian/bicycle", RoadUser.BICYCLE: "bicycle"}
_IND_CLASSES = {RoadUser.OTHER: "trailer"}

_Table = tuple[tuple[str, ...], Iterable[Iterable[object]]]


def write_csv(tracks: Tracks, layout: str, folder: Path) -> Path:
    """Write tracks as the files of a data set; the column map of the same name reads them.

    Args:
        tracks: The tracks.
        layout: `ind` (three files), `interaction` or `ngsim` (10 Hz only; ngsim has no heading, no
            pedestrians and no bicycles, and calls a bus a truck).
        folder: Output folder; it must exist.

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
    files = _LAYOUTS[layout](tracks)
    paths = [folder / pattern.format(name) for pattern in files]
    for path, (head, rows) in zip(paths, files.values(), strict=True):
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(rows)
        write_atomically(path, text.getvalue())
    return paths[0]


def _ind(tracks: Tracks) -> dict[str, _Table]:
    kinds = [_IND_CLASSES.get(kind, kind.name.lower()) for kind in _kinds(tracks)]
    starts = tracks.starts
    age = np.arange(tracks.n_states) - starts[tracks.track]
    states = zip(
        *([0] * tracks.n_states, tracks.identity[tracks.track].tolist()),
        *(tracks.frame.tolist(), age.tolist()),
        *(column.tolist() for column in (tracks.x, tracks.y, np.degrees(tracks.heading) % 360)),
        *(tracks.width[tracks.track].tolist(), tracks.length[tracks.track].tolist()),
        *(tracks.vx.tolist(), tracks.vy.tolist()),
        strict=True,
    )
    first, last = tracks.frame[starts[:-1]], tracks.frame[starts[1:] - 1]
    users = zip(
        *([0] * tracks.n_tracks, tracks.identity.tolist(), first.tolist(), last.tolist()),
        *((last - first + 1).tolist(), tracks.width.tolist(), tracks.length.tolist(), kinds),
        strict=True,
    )
    sizes = ("width", "length")
    heads = (
        *("recordingId", "trackId", "frame", "trackLifetime", "xCenter", "yCenter", "heading"),
        *(*sizes, "xVelocity", "yVelocity"),
    )
    meta = ("recordingId", "trackId", "initialFrame", "finalFrame", "numFrames", *sizes, "class")
    return {
        "{}_tracks.csv": (heads, states),
        "{}_tracksMeta.csv": (meta, users),
        "{}_recordingMeta.csv": (("recordingId", "frameRate"), [(0, 1 / tracks.dt)]),
    }


def _interaction(tracks: Tracks) -> dict[str, _Table]:
    _check_rate(tracks, "interaction")
    kinds = [_INTERACTION_CLASSES.get(kind, kind.name.lower()) for kind in _kinds(tracks)]
    states = zip(
        *(tracks.identity[tracks.track].tolist(), tracks.frame.tolist()),
        *(
            (tracks.frame.astype(np.int64) * 100).tolist(),
            [kinds[number] for number in tracks.track],
        ),
        *(column.tolist() for column in (tracks.x, tracks.y, tracks.vx, tracks.vy)),
        *(tracks.heading.tolist(), tracks.length[tracks.track].tolist()),
        tracks.width[tracks.track].tolist(),
        strict=True,
    )
    head = (
        *("track_id", "frame_id", "timestamp_ms", "agent_type", "x", "y", "vx", "vy"),
        *("psi_rad", "length", "width"),
    )
    return {"vehicle_tracks_{}.csv": (head, states)}


def _ngsim(tracks: Tracks) -> dict[str, _Table]:
    _check_rate(tracks, "ngsim")
    kinds = _kinds(tracks)
    absent = next((kind for kind in kinds if kind not in _NGSIM_CLASSES), None)
    if absent is not None:
        raise UserError(f"the ngsim layout has no class for {absent.name}: leave such tracks out")
    length, width = tracks.length[tracks.track], tracks.width[tracks.track]
    front_x = tracks.x + length / 2 * np.cos(tracks.heading)
    front_y = tracks.y + length / 2 * np.sin(tracks.heading)
    feet = (front_x, front_y, length, width, np.hypot(tracks.vx, tracks.vy))
    life = np.diff(tracks.starts)[tracks.track]
    states = zip(
        *(tracks.identity[tracks.track].tolist(), tracks.frame.tolist(), life.tolist()),
        (tracks.frame.astype(np.int64) * 100).tolist(),
        *((column / FOOT).tolist() for column in feet),
        *(
            [_NGSIM_CLASSES[kinds[number]] for number in tracks.track],
            [tracks.recording] * len(life),
        ),
        strict=True,
    )
    head = (
        *("Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y"),
        *("v_Length", "v_Width", "v_Vel", "v_Class", "Location"),
    )
    return {"{}.csv": (head, states)}


_LAYOUTS: dict[str, Callable[[Tracks], dict[str, _Table]]] = {
    "ind": _ind,
    "interaction": _interaction,
    "ngsim": _ngsim,
}


def _kinds(tracks: Tracks) -> list[RoadUser]:
    return [RoadUser(int(kind)) for kind in tracks.road_user]


def _check_rate(tracks: Tracks, layout: str) -> None:
    if abs(tracks.dt - _TEN_HERTZ) > 1e-9:
        raise UserError(f"the {layout} layout has 10 frames a second, not {1 / tracks.dt:g}")


def write_commonroad(recording: Recording, path: Path) -> None:
    """Write a recording as CommonRoad XML 2020a.

    A velocity that is not along the heading is written with a slip angle. Signs get the numbers
    of the format's fictitious country ZAM.

    Args:
        recording: Its name becomes the benchmark's; other readers require a name such as
            `ZAM_Cross-1_1_T-1`.
        path: The file.

    Raises:
        UserError: If two elements have the same number, or the file can't be written.
    """
    tracks, road = recording.tracks, recording.road
    taken = [*tracks.identity.tolist(), *road.lanelets]
    if len(set(taken)) < len(taken):
        twice = next(number for number in taken if taken.count(number) > 1)
        raise UserError(f"number {twice} has two elements: CommonRoad numbers each element once")
    root = ElementTree.Element(
        "commonRoad",
        timeStepSize=_decimal(tracks.dt),
        commonRoadVersion="2020a",
        benchmarkID=tracks.recording,
        author="socialiq",
        affiliation="",
        source=str(tracks.source.get("made_by", "socialiq")),
        date="2026-01-01",
    )
    ElementTree.SubElement(ElementTree.SubElement(root, "scenarioTags"), "intersection")
    _write_road(root, road, count(max(taken) + 1))
    _write_obstacles(root, tracks)
    ElementTree.indent(root, " ")
    text = ElementTree.tostring(root, encoding="unicode")
    write_atomically(path, f"<?xml version='1.0' encoding='utf-8'?>\n{text}\n")


def _write_road(root: ElementTree.Element, road: RoadNetwork, free: Iterable[int]) -> None:
    numbers = iter(free)
    signs: list[tuple[int, str, str]] = []
    lights: dict[int, Cycle | None] = {}
    for lanelet in road.lanelets.values():
        element = _write_lanelet(root, lanelet)
        signed = [(words.SIGN_NUMBERS[lanelet.sign], "")] if lanelet.sign > 0 else []
        if np.isfinite(lanelet.speed_limit):
            signed.append((words.SPEED_LIMIT_NUMBER, _decimal(lanelet.speed_limit)))
        for number, value in signed:
            identity = next(numbers)
            if number == words.LIGHT:
                lights[identity] = lanelet.cycle
                ElementTree.SubElement(element, "trafficLightRef", ref=str(identity))
            else:
                signs.append((identity, number, value))
                ElementTree.SubElement(element, "trafficSignRef", ref=str(identity))
    for identity, number, value in signs:
        sign = ElementTree.SubElement(root, "trafficSign", id=str(identity))
        inside = ElementTree.SubElement(sign, "trafficSignElement")
        ElementTree.SubElement(inside, "trafficSignID").text = number
        if value:
            ElementTree.SubElement(inside, "additionalValue").text = value
        ElementTree.SubElement(sign, "virtual").text = "true"
    for identity, cycle in lights.items():
        light = ElementTree.SubElement(root, "trafficLight", id=str(identity))
        _write_cycle(light, cycle)
        ElementTree.SubElement(light, "active").text = "true"


def _write_cycle(light: ElementTree.Element, cycle: Cycle | None) -> None:
    """Write a cycle; other readers require one also where its colours are unknown."""
    element = ElementTree.SubElement(light, "cycle")
    if cycle is None:
        return
    word_of = {colour: word for word, colour in words.COLOURS.items()}
    for colour, length in cycle.phases:
        phase = ElementTree.SubElement(element, "cycleElement")
        ElementTree.SubElement(phase, "duration").text = str(length)
        ElementTree.SubElement(phase, "color").text = word_of[colour]
    ElementTree.SubElement(element, "timeOffset").text = str(cycle.offset)


def _write_lanelet(root: ElementTree.Element, lanelet: Lanelet) -> ElementTree.Element:
    element = ElementTree.SubElement(root, "lanelet", id=str(lanelet.identity))
    for name, bound in (("leftBound", lanelet.left), ("rightBound", lanelet.right)):
        inside = ElementTree.SubElement(element, name)
        for x, y in bound:
            _write_point(inside, x, y)
    for name, numbers in (("predecessor", lanelet.predecessors), ("successor", lanelet.successors)):
        for number in numbers:
            ElementTree.SubElement(element, name, ref=str(number))
    sides = (("adjacentLeft", lanelet.adjacent_left), ("adjacentRight", lanelet.adjacent_right))
    for name, beside in sides:
        if beside is not None:
            way = "same" if beside[1] else "opposite"
            ElementTree.SubElement(element, name, ref=str(beside[0]), drivingDir=way)
    if lanelet.stop_line is not None:
        inside = ElementTree.SubElement(element, "stopLine")
        for x, y in lanelet.stop_line:
            _write_point(inside, x, y)
        ElementTree.SubElement(inside, "lineMarking").text = "solid"
    ElementTree.SubElement(element, "laneletType").text = "urban"
    return element


def _write_obstacles(root: ElementTree.Element, tracks: Tracks) -> None:
    along, across = tracks.along_and_across()
    # A lateral part at the level of rounding is 0. Other readers require the states of a track to
    # have the same fields, so a single sliding state gives its whole track a slip angle.
    slides = np.zeros(tracks.n_tracks, bool)
    np.logical_or.at(slides, tracks.track, np.abs(across) > 1e-9)
    slips = slides[tracks.track]
    speed = np.where(slips, np.hypot(along, across), along)
    slip = np.arctan2(across, along)
    for track, (first, end) in enumerate(zip(tracks.starts[:-1], tracks.starts[1:], strict=True)):
        identity = str(tracks.identity[track])
        element = ElementTree.SubElement(root, "dynamicObstacle", id=identity)
        kind = RoadUser(int(tracks.road_user[track]))
        ElementTree.SubElement(element, "type").text = words.TYPES_WRITTEN[kind]
        shape = ElementTree.SubElement(ElementTree.SubElement(element, "shape"), "rectangle")
        ElementTree.SubElement(shape, "length").text = _decimal(tracks.length[track])
        ElementTree.SubElement(shape, "width").text = _decimal(tracks.width[track])
        inside = ElementTree.SubElement(element, "initialState")
        trajectory = ElementTree.SubElement(element, "trajectory") if end > first + 1 else element
        for row in range(first, end):
            state = inside if row == first else ElementTree.SubElement(trajectory, "state")
            _write_point(ElementTree.SubElement(state, "position"), tracks.x[row], tracks.y[row])
            exact = {
                "orientation": _decimal(tracks.heading[row]),
                "time": str(tracks.frame[row]),
                "velocity": _decimal(speed[row]),
            }
            if slips[row]:
                exact["slipAngle"] = _decimal(slip[row])
            for name, text in exact.items():
                value = ElementTree.SubElement(state, name)
                ElementTree.SubElement(value, "exact").text = text


def _write_point(parent: ElementTree.Element, x: float, y: float) -> None:
    point = ElementTree.SubElement(parent, "point")
    ElementTree.SubElement(point, "x").text = _decimal(x)
    ElementTree.SubElement(point, "y").text = _decimal(y)


def _decimal(value: float) -> str:
    """Return the shortest text of the same number; the format's schema has no exponents."""
    return np.format_float_positional(value, unique=True, trim="0")
