"""Import of recorded traffic: read a file of any format, and keep plausible tracks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from socialiq.errors import UserError, one_of
from socialiq.recordings.physics import sift
from socialiq.recordings.readers.column_map import ColumnMap
from socialiq.recordings.readers.commonroad import MOST_STATES, read_commonroad
from socialiq.recordings.readers.csv_recording import read_csv
from socialiq.recordings.recording import Imported, Recording

FORMATS = ("commonroad", "csv")


def import_file(
    path: Path,
    format: str = "commonroad",
    columns: ColumnMap | None = None,
    most_states: int = MOST_STATES,
) -> list[Imported]:
    """Read the recordings of a file and check them.

    Args:
        path: The file.
        format: One of `FORMATS`.
        columns: Column map of a CSV file.
        most_states: More than these are refused before they fill the memory.

    Returns:
        The recordings, with the tracks that passed, and the reason for each other track.

    Raises:
        UserError: If the file can't be read, or most tracks fail in the same way; the line names
            the file.
    """
    one_of("format", format, FORMATS)
    if format == "commonroad":
        return [_sifted(path, read_commonroad(path, most_states))]
    if columns is None:
        raise UserError("a CSV file needs a column map: name one with --columns")
    return [_sifted(path, one) for one in read_csv(path, columns, most_states)]


def _sifted(path: Path, imported: Imported) -> Imported:
    try:
        tracks, refused = sift(imported.recording.tracks)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    recording = Recording(tracks, imported.recording.road)
    return replace(imported, recording=recording, refused=(*imported.refused, *refused))
