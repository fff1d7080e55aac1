"""Recordings as checked files (storage.py): the tracks' columns, the road's arrays, a header."""

from __future__ import annotations

from dataclasses import replace
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
    """Write a recording to one file, whole or not at all.

    Args:
        path: The file; its folder must exist.
        recording: Tracks and road.

    Returns:
        The SHA-256 of the content, the same for every recording of the same content.

    Raises:
        UserError: If the file can't be written.
    """
    tracks = recording.tracks
    header = {"dt": tracks.dt, "recording": tracks.recording, "source": tracks.source}
    lights = lights_of(recording.road)
    arrays = tracks.arrays() | _arrays_of(recording.road) | lights
    version = SECOND_VERSION if lights else SCHEMA_VERSION
    return storage.save_arrays(path, KIND, version, arrays, header)


def load(path: Path) -> Recording:
    """Read a recording, checking the file's bytes and then every column.

    Raises:
        UserError: If the file is missing, damaged, of another kind or version, or its content
            isn't a valid recording; the line names the file.
    """
    arrays, header = storage.load_arrays(path, KIND, (SCHEMA_VERSION, SECOND_VERSION))
    lights = LIGHTS if header["version"] == SECOND_VERSION else {}
    expected = {*STATES, *ROAD_USERS, *ROAD, *lights}
    if set(arrays) != expected or not isinstance(header.get("source"), dict):
        raise UserError(f"{path} lacks a column or its source: make the file again")
    columns = {name: arrays[name] for name in (*STATES, *ROAD_USERS)}
    try:
        tracks = Tracks(
            **columns,
            dt=header.get("dt"),  # type: ignore[arg-type] # `Tracks` checks it
            recording=header.get("recording"),  # type: ignore[arg-type]
            source=header["source"],
        )
        road = _road_of(arrays)
        return Recording(tracks, with_lights(road, arrays) if lights else road)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


def _arrays_of(road: RoadNetwork) -> dict[str, np.ndarray]:
    lanelets = list(road.lanelets.values())
    rows: dict[str, list[Any]] = {
        "lanelet": [one.identity for one in lanelets],
        "lanelet_points": [len(one.left) for one in lanelets],
        "left": [point for one in lanelets for point in one.left],
        "right": [point for one in lanelets for point in one.right],
        "successor": [(one.identity, other) for one in lanelets for other in one.successors],
        "predecessor": [(one.identity, other) for one in lanelets for other in one.predecessors],
        "adjacent_left": _beside(lanelets, "adjacent_left"),
        "adjacent_right": _beside(lanelets, "adjacent_right"),
        "speed_limit": [one.speed_limit for one in lanelets],
        "sign": [one.sign for one in lanelets],
        "stop_line": [
            (one.identity, *np.ravel(one.stop_line))
            for one in lanelets
            if one.stop_line is not None
        ],
    }
    return {
        name: np.array(rows[name], dtype).reshape(-1, *shape)
        for name, (dtype, shape) in ROAD.items()
    }


def lights_of(road: RoadNetwork) -> dict[str, np.ndarray]:
    """Return the arrays of a road's cycles of lights, none if it has none."""
    cycles = {
        identity: one.cycle for identity, one in road.lanelets.items() if one.cycle is not None
    }
    if not cycles:
        return {}
    phases = [(identity, *phase) for identity, one in cycles.items() for phase in one.phases]
    lights = [(identity, one.offset) for identity, one in cycles.items()]
    return {"light": np.array(lights, np.int64), "light_phase": np.array(phases, np.int64)}


def with_lights(road: RoadNetwork, arrays: dict[str, np.ndarray]) -> RoadNetwork:
    """Return a road with the cycles of lights that `lights_of` made arrays of.

    Raises:
        UserError: If the arrays don't fit the road or each other.
    """
    for name, (dtype, shape) in LIGHTS.items():
        if arrays[name].dtype != dtype or arrays[name].shape[1:] != shape:
            raise UserError(f"array {name} has another type or shape: make the file again")
    lights, phases = arrays["light"], arrays["light_phase"]
    numbers, colours = lights[:, 0].tolist(), {int(one) for one in Colour}
    if (
        len({*numbers}) < len(numbers)
        or not {*numbers} <= {*road.lanelets}
        or {*phases[:, 0].tolist()} != {*numbers}
        or not {*phases[:, 1].tolist()} <= colours
        or (phases[:, 2] < 1).any()
    ):
        raise UserError("the cycles of lights don't fit together: make the file again")
    lanelets = dict(road.lanelets)
    for identity, offset in lights.tolist():
        mine = phases[phases[:, 0] == identity, 1:].tolist()
        cycle = Cycle(tuple((Colour(colour), length) for colour, length in mine), offset)
        lanelets[identity] = replace(lanelets[identity], cycle=cycle)
    return RoadNetwork(lanelets)


def _beside(lanelets: list[Lanelet], side: str) -> list[tuple[int, int, int]]:
    pairs = [(one.identity, getattr(one, side)) for one in lanelets]
    return [(identity, other[0], int(other[1])) for identity, other in pairs if other is not None]


def _road_of(arrays: dict[str, np.ndarray]) -> RoadNetwork:
    for name, (dtype, shape) in ROAD.items():
        if arrays[name].dtype != dtype or arrays[name].shape[1:] != shape:
            raise UserError(f"array {name} has another type or shape: make the file again")
    numbers, points = arrays["lanelet"].tolist(), arrays["lanelet_points"]
    whole = len(points) == len(numbers) == len(arrays["speed_limit"]) == len(arrays["sign"])
    known = set(numbers)
    signs = {int(sign) for sign in Sign}
    pairs = ("successor", "predecessor", "adjacent_left", "adjacent_right", "stop_line")
    if (
        not whole
        or len(known) < len(numbers)
        or (points < 2).any()
        or not points.sum() == len(arrays["left"]) == len(arrays["right"])
        or not {*arrays["sign"].tolist()} <= signs
        or any(not {*arrays[name][:, 0].tolist()} <= known for name in pairs)
    ):
        raise UserError("the road's arrays don't fit together: make the file again")
    return RoadNetwork({one.identity: one for one in _lanelets(arrays)})


def _lanelets(arrays: dict[str, np.ndarray]) -> list[Lanelet]:
    ends = np.cumsum(arrays["lanelet_points"])[:-1]
    left, right = np.split(arrays["left"], ends), np.split(arrays["right"], ends)
    beside = {
        side: {int(one): (int(other), bool(same)) for one, other, same in arrays[side]}
        for side in ("adjacent_left", "adjacent_right")
    }
    lines = {int(row[0]): row[1:].reshape(2, 2) for row in arrays["stop_line"]}
    lead_to, lead_from = _by_first(arrays["successor"]), _by_first(arrays["predecessor"])
    return [
        Lanelet(
            identity=identity,
            left=left[place],
            right=right[place],
            successors=lead_to.get(identity, ()),
            predecessors=lead_from.get(identity, ()),
            adjacent_left=beside["adjacent_left"].get(identity),
            adjacent_right=beside["adjacent_right"].get(identity),
            speed_limit=float(arrays["speed_limit"][place]),
            sign=Sign(int(arrays["sign"][place])),
            stop_line=lines.get(identity),
        )
        for place, identity in enumerate(arrays["lanelet"].tolist())
    ]


def _by_first(pairs: np.ndarray) -> dict[int, tuple[int, ...]]:
    found: dict[int, tuple[int, ...]] = {}
    for one, other in pairs.tolist():
        found[one] = (*found.get(one, ()), other)
    return found
