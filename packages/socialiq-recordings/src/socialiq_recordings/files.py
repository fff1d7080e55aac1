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
        "lanelet": [lanelet.identity for lanelet in lanelets],
        "lanelet_points": [len(lanelet.left) for lanelet in lanelets],
        "left": [point for lanelet in lanelets for point in lanelet.left],
        "right": [point for lanelet in lanelets for point in lanelet.right],
        "successor": [
            (lanelet.identity, neighbour)
            for lanelet in lanelets
            for neighbour in lanelet.successors
        ],
        "predecessor": [
            (lanelet.identity, neighbour)
            for lanelet in lanelets
            for neighbour in lanelet.predecessors
        ],
        "adjacent_left": _beside(lanelets, "adjacent_left"),
        "adjacent_right": _beside(lanelets, "adjacent_right"),
        "speed_limit": [lanelet.speed_limit for lanelet in lanelets],
        "sign": [lanelet.sign for lanelet in lanelets],
        "stop_line": [
            (lanelet.identity, *np.ravel(lanelet.stop_line))
            for lanelet in lanelets
            if lanelet.stop_line is not None
        ],
    }
    return {
        name: np.array(rows[name], dtype).reshape(-1, *shape)
        for name, (dtype, shape) in ROAD.items()
    }


def lights_of(road: RoadNetwork) -> dict[str, np.ndarray]:
    """Return the arrays of a road's cycles of lights, none if it has none."""
    cycles = {
        identity: lanelet.cycle
        for identity, lanelet in road.lanelets.items()
        if lanelet.cycle is not None
    }
    if not cycles:
        return {}
    phases = [
        (identity, *phase) for identity, lanelet in cycles.items() for phase in lanelet.phases
    ]
    lights = [(identity, lanelet.offset) for identity, lanelet in cycles.items()]
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
    numbers, colours = lights[:, 0].tolist(), {int(colour) for colour in Colour}
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
        of_light = phases[phases[:, 0] == identity, 1:].tolist()
        cycle = Cycle(tuple((Colour(colour), length) for colour, length in of_light), offset)
        lanelets[identity] = replace(lanelets[identity], cycle=cycle)
    return RoadNetwork(lanelets)


def _beside(lanelets: list[Lanelet], side: str) -> list[tuple[int, int, int]]:
    pairs = [(lanelet.identity, getattr(lanelet, side)) for lanelet in lanelets]
    return [
        (identity, neighbour[0], int(neighbour[1]))
        for identity, neighbour in pairs
        if neighbour is not None
    ]


def _road_of(arrays: dict[str, np.ndarray]) -> RoadNetwork:
    for name, (dtype, shape) in ROAD.items():
        if arrays[name].dtype != dtype or arrays[name].shape[1:] != shape:
            raise UserError(f"array {name} has another type or shape: make the file again")
    numbers, points = arrays["lanelet"].tolist(), arrays["lanelet_points"]
    complete = len(points) == len(numbers) == len(arrays["speed_limit"]) == len(arrays["sign"])
    identities = set(numbers)
    signs = {int(sign) for sign in Sign}
    pairs = ("successor", "predecessor", "adjacent_left", "adjacent_right", "stop_line")
    if (
        not complete
        or len(identities) < len(numbers)
        or (points < 2).any()
        or not points.sum() == len(arrays["left"]) == len(arrays["right"])
        or not {*arrays["sign"].tolist()} <= signs
        or any(not {*arrays[name][:, 0].tolist()} <= identities for name in pairs)
    ):
        raise UserError("the road's arrays don't fit together: make the file again")
    return RoadNetwork({lanelet.identity: lanelet for lanelet in _lanelets(arrays)})


def _lanelets(arrays: dict[str, np.ndarray]) -> list[Lanelet]:
    ends = np.cumsum(arrays["lanelet_points"])[:-1]
    left, right = np.split(arrays["left"], ends), np.split(arrays["right"], ends)
    beside = {
        side: {
            int(number): (int(neighbour), bool(same)) for number, neighbour, same in arrays[side]
        }
        for side in ("adjacent_left", "adjacent_right")
    }
    lines = {int(row[0]): row[1:].reshape(2, 2) for row in arrays["stop_line"]}
    lead_to, lead_from = _by_first(arrays["successor"]), _by_first(arrays["predecessor"])
    return [
        Lanelet(
            identity=identity,
            left=left[index],
            right=right[index],
            successors=lead_to.get(identity, ()),
            predecessors=lead_from.get(identity, ()),
            adjacent_left=beside["adjacent_left"].get(identity),
            adjacent_right=beside["adjacent_right"].get(identity),
            speed_limit=float(arrays["speed_limit"][index]),
            sign=Sign(int(arrays["sign"][index])),
            stop_line=lines.get(identity),
        )
        for index, identity in enumerate(arrays["lanelet"].tolist())
    ]


def _by_first(pairs: np.ndarray) -> dict[int, tuple[int, ...]]:
    neighbours: dict[int, tuple[int, ...]] = {}
    for number, neighbour in pairs.tolist():
        neighbours[number] = (*neighbours.get(number, ()), neighbour)
    return neighbours
