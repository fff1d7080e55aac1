"""Scenarios of Argoverse 2 motion forecasting: a Parquet table of tracks, and a map in JSON.

The layout: Wilson et al., "Argoverse 2: Next generation datasets for self-driving perception and
forecasting" (NeurIPS 2021 datasets): `scenario_ID.parquet`, and `log_map_archive_ID.json` in the
same folder. Parquet is read by pyarrow (extra `parquet`). The makers' own package av2 reads the
same two files, but needs PyTorch, OpenCV, kornia and PyAV for it.
"""

import functools
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.physics import wrapped_heading
from socialiq.reading import check_file, sha256_of_file
from socialiq.storage import read_json
from socialiq_recordings.readers import tracks
from socialiq_recordings.recording import Imported, RoadUser
from socialiq_recordings.road.network import Elements, Lanelet, RoadNetwork, equal_bounds

DT = 0.1  # s; scenarios have 10 states a second, for 11 s
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
_TEXTS = ("track_id", "object_type", "scenario_id", "city")
_STATES = ("position_x", "position_y", "heading", "velocity_x", "velocity_y")


def read_argoverse(path: Path, most_states: int = tracks.MOST_STATES) -> Imported:
    """Read a scenario, `scenario_ID.parquet`, with the map in its folder, if there is one.

    Raises:
        UserError: If a file can't be read, lacks a column, has more states than `most_states`, or
            no track can be used.
    """
    table = _table(path, most_states)
    kinds = table["object_type"]
    gathered = tracks.Gathered(path)
    names = []
    gathered.n_states = len(kinds)
    for kind in _OBJECTS:
        gathered.note(kind, int((kinds == kind).sum()))
    # Rows by road user, in order of time.
    users = np.flatnonzero(~np.isin(kinds.astype(str), _OBJECTS))
    number = np.unique(table["track_id"][users].astype(str), return_inverse=True)[1]
    order = np.lexsort([table["timestep"][users], number])
    ends = np.flatnonzero(np.diff(number[order])) + 1
    for track in np.split(users[order], ends) if len(users) else []:
        name = one_line(str(table["track_id"][track[0]]), 60)
        kind = str(kinds[track[0]])
        states = np.stack([table[column][track] for column in _STATES])
        again = tracks.repeated(table["timestep"][track], states)
        gathered.note("repeated state", int(again.sum()))
        track = track[~again]
        states = states[:, ~again]

        def row(at: int, rows: np.ndarray = track) -> str:
            return f"row {rows[at] + 1}: "

        try:
            if (kinds[track] != kind).any():
                raise ValueError(f"its class changes from '{kind}'")
            tracks.check_frames(table["timestep"][track], row)
            tracks.check_numbers("a value", np.abs(states).max(axis=0), row)
        except ValueError as error:
            gathered.refuse(name, error, KINDS.get(kind, KINDS["unknown"])[0])
            continue
        states[2] = wrapped_heading(states[2])
        names.append(name)
        if kind not in KINDS:
            gathered.unknown(name, f"object type '{one_line(kind, 40)}' is unknown")
        user = KINDS.get(kind, KINDS["unknown"])
        gathered.add(len(names), user, table["timestep"][track], states)
    beside = path.with_name(f"log_map_archive_{path.stem.removeprefix('scenario_')}.json")
    recording = one_line(table["scenario_id"][0], 60) or path.stem
    source: dict[str, Any] = {
        "format": "argoverse",
        "file": path.name,
        "sha256": sha256_of_file(path),
        "licence": LICENCE,
        "city": one_line(table["city"][0], 60),
        "track_ids": names,
    }
    road = read_map(beside) if beside.exists() else RoadNetwork()
    return gathered.imported(recording, DT, source, road)


def _table(path: Path, most_states: int) -> dict[str, np.ndarray]:
    check_file(path)
    parquet = optional("pyarrow.parquet", "parquet", "an Argoverse 2 scenario")
    needed = (*_TEXTS, "timestep", *_STATES)
    try:
        file = parquet.ParquetFile(path)
        missing = [name for name in needed if name not in file.schema_arrow.names]
        if missing:
            raise UserError(f"{path} has no column {', '.join(missing)}: name a scenario's table")
        if not 0 < file.metadata.num_rows <= most_states:
            raise UserError(
                f"{path} holds {file.metadata.num_rows:,} states, and at most {most_states:,} are "
                "read: name a scenario's table, or raise --most-states"
            )
        columns = file.read(columns=list(needed)).to_pydict()
        table = {name: np.array([str(text) for text in columns[name]], object) for name in _TEXTS}
        table |= {name: np.array(columns[name], np.float64) for name in _STATES}
        return table | {"timestep": np.array(columns["timestep"], np.int64)}
    except UserError:
        raise
    except Exception as error:  # pyarrow has many
        raise UserError(f"cannot read {path} as Parquet: {one_line(str(error))}") from error


def read_map(path: Path) -> RoadNetwork:
    """Read the lane segments of vehicles and buses of a scenario's map.

    Raises:
        UserError: If it or most segments can't be read; the line has the first one's number.
    """
    content = read_json(path)
    segments = content.get("lane_segments") if isinstance(content, dict) else None
    if not isinstance(segments, dict):
        raise UserError(f"{path} has no lane_segments: name a map of Argoverse 2")
    elements = Elements(path)
    for number, segment in segments.items():
        if not isinstance(segment, dict) or segment.get("lane_type") != "BIKE":
            name = f"lane segment {one_line(str(number), 30)}"
            elements.add(name, functools.partial(_lanelet, segment))
    return elements.road()


def _lanelet(segment: dict[str, Any]) -> Lanelet:
    bounds = []
    beside = []
    for side in ("left", "right"):
        points = [(float(at["x"]), float(at["y"])) for at in segment[f"{side}_lane_boundary"]]
        bounds.append(np.array(points).reshape(-1, 2))
        neighbour = segment.get(f"{side}_neighbor_id")
        # It may have the other direction, which the map doesn't say: none is taken as same.
        beside.append(None if neighbour is None else (int(neighbour), False))
    left, right = equal_bounds(*bounds)
    return Lanelet(
        int(segment["id"]),
        left,
        right,
        tuple(int(number) for number in segment["successors"]),
        tuple(int(number) for number in segment["predecessors"]),
        *beside,
    )
