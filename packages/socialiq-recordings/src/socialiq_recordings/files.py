"""Recordings as checked files (storage.py): the tracks' columns, the road's arrays, a header."""

from pathlib import Path
from typing import Any

import numpy as np

from socialiq import storage
from socialiq.errors import UserError
from socialiq_recordings.recording import ROAD_USERS, STATES, Recording, Tracks
from socialiq_recordings.road.network import Colour, Cycle, Lanelet, RoadNetwork, Sign

KIND = "recording"
SCHEMA_VERSION = 1
SECOND_VERSION = 2
"""Schema version of recordings with cycles of lights, which a reader of version 1 would miss."""

ROAD: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "lanelet": (np.int64, ()),
    "lanelet_points": (np.int64, ()),
    "left": (np.float64, (2,)),
    "right": (np.float64, (2,)),
    "successor": (np.int64, (2,)),
    "predecessor": (np.int64, (2,)),
    "adjacent_left": (np.int64, (3,)),
    "adjacent_right": (np.int64, (3,)),
    "speed_limit": (np.float64, ()),
    "sign": (np.int8, ()),
    "stop_line": (np.float64, (5,)),
}
"""The road's arrays: type, and shape of one row. Rows of pairs begin with the lanelet's number."""

LIGHTS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "light": (np.int64, (2,)),
    "light_phase": (np.int64, (3,)),
}
"""Arrays of version 2: lanelet and offset of a cycle; lanelet, colour and frames of a phase."""


def save(path: Path, recording: Recording) -> str:
    """Write a recording to one file, whole or not at all; the folder must exist.

    Returns:
        The SHA-256 of the content, the same for every recording of the same content.

    Raises:
        UserError: If the file can't be written.
    """
    tracks = recording.tracks
    lanelets = list(recording.road.lanelets.values())
    header = {"dt": tracks.dt, "recording": tracks.recording, "source": tracks.source}
    rows: dict[str, list[Any]] = {name: [] for name in (*ROAD, *LIGHTS)}
    for lanelet in lanelets:
        identity = lanelet.identity
        rows["lanelet"].append(identity)
        rows["lanelet_points"].append(len(lanelet.left))
        rows["left"] += list(lanelet.left)
        rows["right"] += list(lanelet.right)
        rows["successor"] += [(identity, number) for number in lanelet.successors]
        rows["predecessor"] += [(identity, number) for number in lanelet.predecessors]
        for side in ("adjacent_left", "adjacent_right"):
            beside = getattr(lanelet, side)
            rows[side] += [] if beside is None else [(identity, *beside)]
        rows["speed_limit"].append(lanelet.speed_limit)
        rows["sign"].append(lanelet.sign)
        if lanelet.stop_line is not None:
            rows["stop_line"].append((identity, *np.ravel(lanelet.stop_line)))
        if lanelet.cycle is not None:
            rows["light"].append((identity, lanelet.cycle.offset))
            rows["light_phase"] += [(identity, *phase) for phase in lanelet.cycle.phases]
    layout = ROAD | LIGHTS if rows["light"] else ROAD
    arrays = tracks.arrays() | {
        name: np.array(rows[name], dtype).reshape(-1, *shape)
        for name, (dtype, shape) in layout.items()
    }
    version = SECOND_VERSION if rows["light"] else SCHEMA_VERSION
    return storage.save_arrays(path, KIND, version, arrays, header)


def load(path: Path) -> Recording:
    """Read a recording, checking the file's bytes and then every column.

    Raises:
        UserError: If the file is missing, damaged, of another kind or version, or its content
            isn't a valid recording; the line names the file.
    """
    arrays, header = storage.load_arrays(path, KIND, (SCHEMA_VERSION, SECOND_VERSION))
    layout = ROAD | LIGHTS if header["version"] == SECOND_VERSION else ROAD
    expected = {*STATES, *ROAD_USERS, *layout}
    if set(arrays) != expected or not isinstance(header.get("source"), dict):
        raise UserError(f"{path} lacks a column or its source: make the file again")
    try:
        tracks = Tracks(
            **{name: arrays[name] for name in (*STATES, *ROAD_USERS)},
            dt=header.get("dt"),  # type: ignore[arg-type] # `Tracks` checks it
            recording=header.get("recording"),  # type: ignore[arg-type]
            source=header["source"],
        )
        for name, (dtype, shape) in layout.items():
            if arrays[name].dtype != dtype or arrays[name].shape[1:] != shape:
                raise UserError(f"array {name} has another type or shape: make the file again")
        cycles = _cycles(arrays) if layout is not ROAD else {}
        return Recording(tracks, _road_of(arrays, cycles))
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


def _cycles(arrays: dict[str, np.ndarray]) -> dict[int, Cycle]:
    """Return the cycles of lights by lanelet."""
    lights = arrays["light"]
    phases = arrays["light_phase"]
    numbers = lights[:, 0].tolist()
    colours = {int(colour) for colour in Colour}
    if (
        len({*numbers}) < len(numbers)
        or not {*numbers} <= {*arrays["lanelet"].tolist()}
        or {*phases[:, 0].tolist()} != {*numbers}
        or not {*phases[:, 1].tolist()} <= colours
        or (phases[:, 2] < 1).any()
    ):
        raise UserError("the cycles of lights don't fit together: make the file again")
    cycles = {}
    for identity, offset in lights.tolist():
        of_light = phases[phases[:, 0] == identity, 1:].tolist()
        cycles[identity] = Cycle(tuple((Colour(c), length) for c, length in of_light), offset)
    return cycles


def _road_of(arrays: dict[str, np.ndarray], cycles: dict[int, Cycle]) -> RoadNetwork:
    numbers = arrays["lanelet"].tolist()
    points = arrays["lanelet_points"]
    complete = len(points) == len(numbers) == len(arrays["speed_limit"]) == len(arrays["sign"])
    pairs = ("successor", "predecessor", "adjacent_left", "adjacent_right", "stop_line")
    if (
        not complete
        or len({*numbers}) < len(numbers)
        or (points < 2).any()
        or not points.sum() == len(arrays["left"]) == len(arrays["right"])
        or not {*arrays["sign"].tolist()} <= {int(sign) for sign in Sign}
        or any(not {*arrays[name][:, 0].tolist()} <= {*numbers} for name in pairs)
    ):
        raise UserError("the road's arrays don't fit together: make the file again")
    rows: dict[str, dict[int, list[Any]]] = {name: {} for name in pairs}
    for name in pairs:
        for row in arrays[name].tolist():
            rows[name].setdefault(int(row[0]), []).append(row[1:])
    ends = np.cumsum(points)[:-1]
    left = np.split(arrays["left"], ends)
    right = np.split(arrays["right"], ends)
    lanelets = {}
    for index, identity in enumerate(numbers):
        of = {name: by_number.get(identity, []) for name, by_number in rows.items()}
        lanelets[identity] = Lanelet(
            identity,
            left[index],
            right[index],
            tuple(number for (number,) in of["successor"]),
            tuple(number for (number,) in of["predecessor"]),
            *(
                (of[side][-1][0], bool(of[side][-1][1])) if of[side] else None
                for side in ("adjacent_left", "adjacent_right")
            ),
            speed_limit=float(arrays["speed_limit"][index]),
            sign=Sign(int(arrays["sign"][index])),
            stop_line=np.reshape(of["stop_line"][-1], (2, 2)) if of["stop_line"] else None,
            cycle=cycles.get(identity),
        )
    return RoadNetwork(lanelets)
