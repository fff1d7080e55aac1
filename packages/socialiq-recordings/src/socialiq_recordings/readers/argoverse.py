"""Scenarios of Argoverse 2 motion forecasting: a Parquet table of tracks, and a map in JSON.

The layout: Wilson et al., "Argoverse 2: Next generation datasets for self-driving perception and
forecasting" (NeurIPS 2021 datasets): `scenario_ID.parquet`, and `log_map_archive_ID.json` beside.
Parquet is read by pyarrow (extra `parquet`). The makers' own package av2 reads the same two files,
but needs PyTorch, OpenCV, kornia and PyAV for it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import check_file, sha256_of_file
from socialiq.storage import read_json
from socialiq_recordings.readers.commonroad import MOST_STATES
from socialiq_recordings.readers.motion import wrapped
from socialiq_recordings.recording import (
    FARTHEST,
    Imported,
    Recording,
    Refused,
    RoadUser,
    Tracks,
    order_fault,
)
from socialiq_recordings.road.network import Lanelet, RoadNetwork, equal_bounds

DT = 0.1
"""s; scenarios have 10 states a second, for 11 s."""

LICENCE = "CC BY-NC-SA 4.0 (Argoverse 2); name Wilson et al. 2021"

KINDS = {
    "vehicle": (RoadUser.CAR, 4.6, 1.9),
    "bus": (RoadUser.BUS, 12.0, 2.6),
    "motorcyclist": (RoadUser.MOTORCYCLE, 2.0, 0.8),
    "cyclist": (RoadUser.BICYCLE, 1.8, 0.6),
    "pedestrian": (RoadUser.PEDESTRIAN, 0.5, 0.5),
    "riderless_bicycle": (RoadUser.OTHER, 1.8, 0.6),
    "unknown": (RoadUser.OTHER, 1.0, 1.0),
}
"""Class, length and width in m by the file's word; scenarios have no sizes, these are typical."""

_OBJECTS = ("static", "background", "construction")  # no road users
_COLUMNS = (
    *("track_id", "object_type", "timestep", "position_x", "position_y", "heading"),
    *("velocity_x", "velocity_y", "scenario_id", "city"),
)


def read_argoverse(path: Path, most_states: int = MOST_STATES) -> Imported:
    """Read a scenario with the map beside it, if there is one.

    Args:
        path: `scenario_ID.parquet`.
        most_states: More rows than these are refused.

    Raises:
        UserError: If a file can't be read, lacks a column, or no track can be used.
    """
    table = _table(path, most_states)
    refused: list[Refused] = []
    skipped = {kind: int(count) for kind in _OBJECTS if (count := (table["kind"] == kind).sum())}
    usable = [track for track in _tracks(path, table) if _usable(table, track, refused)]
    if not usable:
        raise UserError(f"{path} holds no track that can be used")
    rows = np.concatenate(usable)
    users = [KINDS[str(table["kind"][track[0]])] for track in usable]
    tracks = Tracks(
        track=np.repeat(
            np.arange(len(usable), dtype=np.int32), [len(rows_of) for rows_of in usable]
        ),
        frame=table["timestep"][rows].astype(np.int32),
        x=table["position_x"][rows],
        y=table["position_y"][rows],
        heading=wrapped(table["heading"][rows]),
        vx=table["velocity_x"][rows],
        vy=table["velocity_y"][rows],
        identity=np.arange(len(usable), dtype=np.int64) + 1,
        road_user=np.array([int(user[0]) for user in users], np.int8),
        length=np.array([user[1] for user in users]),
        width=np.array([user[2] for user in users]),
        dt=DT,
        recording=one_line(str(table["scenario_id"][0]), 60) or path.stem,
        source={
            "format": "argoverse",
            "file": path.name,
            "sha256": sha256_of_file(path),
            "licence": LICENCE,
            "city": one_line(str(table["city"][0]), 60),
            "track_ids": [one_line(str(table["name"][track[0]]), 60) for track in usable],
        },
    )
    recording = Recording(tracks, _road_beside(path))
    return Imported(recording, tuple(refused), skipped, len(table["kind"]))


def _table(path: Path, most_states: int) -> dict[str, np.ndarray]:
    check_file(path)
    parquet = optional("pyarrow.parquet", "parquet", "an Argoverse 2 scenario")
    try:
        file = parquet.ParquetFile(path)
        missing = [name for name in _COLUMNS if name not in file.schema_arrow.names]
        if missing:
            raise UserError(f"{path} has no column {', '.join(missing)}: name a scenario's table")
        if not 0 < file.metadata.num_rows <= most_states:
            raise UserError(
                f"{path} holds {file.metadata.num_rows:,} states, and at most {most_states:,} are "
                "read: name a scenario's table, or raise --most-states"
            )
        read = file.read(columns=list(_COLUMNS)).to_pydict()
        floats = ("position_x", "position_y", "heading", "velocity_x", "velocity_y")
        columns: dict[str, np.ndarray] = {name: np.array(read[name], np.float64) for name in floats}
        columns["timestep"] = np.array(read["timestep"], np.int64)
    except UserError:
        raise
    except Exception as error:  # pyarrow has many
        raise UserError(f"cannot read {path} as Parquet: {one_line(str(error))}") from error
    columns["name"], columns["kind"] = (
        np.array([str(text) for text in read[name]], object) for name in ("track_id", "object_type")
    )
    return columns | {name: np.array(read[name], object) for name in ("scenario_id", "city")}


def _tracks(path: Path, table: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Return the rows of each road user, in order of time."""
    unknown = {*table["kind"].tolist()} - {*KINDS, *_OBJECTS}
    if unknown:
        raise UserError(f"{path}: object type '{one_line(min(unknown), 40)}' is unknown")
    users = np.flatnonzero(~np.isin(table["kind"].astype(str), _OBJECTS))
    number = np.unique(table["name"][users].astype(str), return_inverse=True)[1]
    order = np.lexsort([table["timestep"][users], number])
    ends = np.flatnonzero(np.diff(number[order])) + 1
    return [rows for rows in np.split(users[order], ends) if len(rows)]


def _usable(table: dict[str, np.ndarray], track: np.ndarray, refused: list[Refused]) -> bool:
    frames = table["timestep"][track]
    fault = order_fault(frames)
    if frames.min() < 0 or frames.max() >= 2**31:
        fault = f"frame {frames.min()} is negative or out of range"
    names = ("position_x", "position_y", "heading", "velocity_x", "velocity_y")
    if not all((np.abs(table[name][track]) <= FARTHEST).all() for name in names):
        fault = "a value is not finite or too large"
    if len({*table["kind"][track].tolist()}) > 1:
        fault = "its class changes"
    if fault:
        refused.append(Refused(one_line(str(table["name"][track[0]]), 60), fault))
    return not fault


def _road_beside(path: Path) -> RoadNetwork:
    scenario = path.stem.removeprefix("scenario_")
    beside = path.with_name(f"log_map_archive_{scenario}.json")
    return read_map(beside) if beside.exists() else RoadNetwork()


def read_map(path: Path) -> RoadNetwork:
    """Read the lane segments of vehicles and buses of a scenario's map.

    Raises:
        UserError: If it can't be read; the line has the segment's number.
    """
    content = read_json(path)
    segments = content.get("lane_segments") if isinstance(content, dict) else None
    if not isinstance(segments, dict):
        raise UserError(f"{path} has no lane_segments: name a map of Argoverse 2")
    road: dict[int, Lanelet] = {}
    for number, segment in segments.items():
        try:
            if segment["lane_type"] != "BIKE":
                lanelet = _lanelet(segment)
                road[lanelet.identity] = lanelet
        except (KeyError, TypeError, ValueError, OverflowError, UserError) as error:
            name = one_line(str(number), 30)
            text = one_line(str(error)).removeprefix(f"lanelet {name}: ")
            raise UserError(f"{path}: lane segment {name}: {text}") from error
    return RoadNetwork(road)


def _lanelet(one: dict[str, Any]) -> Lanelet:
    bounds = [
        np.array([(float(point["x"]), float(point["y"])) for point in one[f"{side}_lane_boundary"]])
        for side in ("left", "right")
    ]
    left, right = equal_bounds(bounds[0].reshape(-1, 2), bounds[1].reshape(-1, 2))
    beside = [one.get(f"{side}_neighbor_id") for side in ("left", "right")]
    # A neighbour may have the other direction, which the map doesn't say: none is taken as same.
    sides = [None if neighbour is None else (int(neighbour), False) for neighbour in beside]
    return Lanelet(
        int(one["id"]),
        left,
        right,
        tuple(int(number) for number in one["successors"]),
        tuple(int(number) for number in one["predecessors"]),
        adjacent_left=sides[0],
        adjacent_right=sides[1],
    )
