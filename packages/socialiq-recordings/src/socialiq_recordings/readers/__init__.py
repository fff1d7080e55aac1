"""Import of recorded traffic: read a file of any format, with a map, and keep plausible tracks."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq_recordings.plausible import MeasurementError, sift
from socialiq_recordings.readers.argoverse import read_argoverse
from socialiq_recordings.readers.column_map import ColumnMap
from socialiq_recordings.readers.commonroad import read_commonroad
from socialiq_recordings.readers.commonroad_road import road_of
from socialiq_recordings.readers.csv_recording import read_csv
from socialiq_recordings.readers.csv_table import origin_of
from socialiq_recordings.readers.lanelet2_road import read_lanelet2
from socialiq_recordings.readers.sind import read_sind
from socialiq_recordings.readers.tracks import MOST_STATES
from socialiq_recordings.recording import Imported, Recording
from socialiq_recordings.road.network import RoadNetwork

FORMATS = ("commonroad", "csv", "argoverse", "sind")
WITHOUT_MAP = ("csv", "sind")
"""Formats whose files bring no map."""


def map_of(path: Path, source: Mapping[str, Any]) -> RoadNetwork:
    """Read a map in the frame of a recording's tracks: CommonRoad XML, a recording, or Lanelet2.

    The recording's provenance has the origin of its frame: `utm_origin`, m, or `origin`, degrees.

    Raises:
        UserError: If it can't be read, or holds no lanelet.
    """
    if path.suffix.lower() != ".osm":
        return road_of(path)
    origins: dict[str, tuple[float, float]] = {}
    for name in ("utm_origin", "origin"):
        if source.get(name) is not None:
            try:
                x, y = (float(coordinate) for coordinate in source[name])
            except (TypeError, ValueError) as error:
                line = f"the recording's {name} is not two numbers: import it again"
                raise UserError(line) from error
            origins[name] = (x, y)
    return read_lanelet2(path, **origins)


def import_file(
    path: Path,
    format: str = "commonroad",
    columns: ColumnMap | None = None,
    most_states: int = MOST_STATES,
    road: Path | None = None,
    error: MeasurementError | None = None,
    origin: tuple[float, float] | None = None,
) -> list[Imported]:
    """Read the recordings of a file, and leave out the tracks that can't be true.

    Args:
        path: The file.
        format: One of `FORMATS`.
        columns: Column map of a CSV file.
        most_states: More than these are refused before they fill the memory.
        road: Map of a CSV or SinD file; its lanes give standing vehicles their heading.
        error: Standard errors of measurement; by default the column map's, or those assumed.
        origin: Latitude and longitude of the origin of such a file's positions, degrees.

    Raises:
        UserError: If the file can't be read, or most tracks fail alike; the line names the file.
    """
    one_of("format", format, FORMATS)
    if format in WITHOUT_MAP:
        if columns is None and format == "csv":
            raise UserError("a CSV file needs a column map: name one with --columns")
        stated = {} if origin is None else {"origin": list(origin)}
        frame = stated or {"utm_origin": columns and origin_of(path, columns)}
        lanelets = None if road is None else map_of(road, frame)
        if columns is None:
            recordings = [read_sind(path, most_states, lanelets, stated)]
        else:
            recordings = read_csv(path, columns, most_states, lanelets, stated)
            error = error or columns.error
    elif origin is not None or road is not None:
        option = "--origin" if origin is not None else "--road"
        raise UserError(f"{option} goes with csv and sind: a {format} file has a map of its own")
    else:
        read = read_commonroad if format == "commonroad" else read_argoverse
        recordings = [read(path, most_states)]
    sifted = []
    for imported in recordings:
        try:
            tracks, refused = sift(imported.recording.tracks, error)
        except UserError as fault:
            raise UserError(f"{path}: {fault}") from fault
        recording = Recording(tracks, imported.recording.road)
        refused = (*imported.refused, *refused)
        sifted.append(replace(imported, recording=recording, refused=refused))
    return sifted
