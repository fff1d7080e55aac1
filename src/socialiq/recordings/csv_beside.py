"""The files beside a CSV file of states: sizes and classes of its tracks, its frame rate."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from socialiq.errors import UserError
from socialiq.recordings.columns import ColumnMap
from socialiq.recordings.csv_table import Table


def _beside(path: Path, endings: tuple[str, str]) -> Path:
    if not path.name.endswith(endings[0]):
        raise UserError(
            f"{path}: the column map wants a name that ends in {endings[0]}, to find the file that "
            f"ends in {endings[1]}"
        )
    return path.with_name(path.name.removesuffix(endings[0]) + endings[1])


def rate_of(path: Path, columns: ColumnMap) -> float:
    """Frames a second, by the column map or the file that it names.

    Raises:
        UserError: If that file is missing, or has no such number or several.
    """
    if columns.rate_file is None:
        return columns.rate
    *endings, column = columns.rate_file
    beside = Table(_beside(path, (endings[0], endings[1])), columns.separator, 100)
    beside.read({"rate": column}, frozenset(), frozenset())
    rates = np.unique(beside["rate"])
    if len(rates) != 1 or not 0 < rates[0] < np.inf:
        raise UserError(f"{beside.path}: {column} is not one number of frames a second")
    return float(rates[0])


def users_of(path: Path, columns: ColumnMap) -> Table | None:
    """The file with a row for each track; None where the column map names none.

    Raises:
        UserError: If it is missing, can't be read, or has two rows for one track.
    """
    if columns.users_file is None:
        return None
    users = Table(_beside(path, columns.users_file), columns.separator, 10_000_000)
    users.read(columns.users_columns, frozenset({"class"}), frozenset({"id"}))
    order = np.sort(users["id"])
    twice = order[1:][order[1:] == order[:-1]]
    if len(twice):
        raise UserError(f"{users.path}: {int(twice[0])} has two rows: leave one")
    return users
