"""Flat columns of steps as CSV: numbers are written so that they are read back to the bit."""

from __future__ import annotations

import csv
import io
from array import array
from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq.datasets.step_columns import Kind, check_names, kind_of
from socialiq.errors import UserError
from socialiq.foreign import one_line

MOST_BYTES = 2 * 1024**3
"""Largest size of a file, bytes; in memory a cell takes at most 8 bytes."""

_FLAGS = {"true": 1, "false": 0, "1": 1, "0": 0}


def _plain(cell: str) -> str:
    """Return a cell without spaces; Python alone reads 1_000 as a number."""
    if "_" in cell:
        raise ValueError
    return cell.strip()


class _Parser(NamedTuple):
    """Reader of a column's cells, and the type that holds them in memory."""

    name: str
    code: str
    read: Callable[[str], Any]


_PARSERS: dict[Kind | None, _Parser] = {
    "number": _Parser("a number", "d", lambda cell: float(_plain(cell))),
    "integer": _Parser("an integer", "q", lambda cell: int(_plain(cell))),
    "flag": _Parser("true or false", "b", lambda cell: _FLAGS[cell.strip().lower()]),
}


def read_csv(path: Path) -> dict[str, np.ndarray]:
    """Read the columns of a CSV file of steps (UTF-8, comma, first line with the names).

    Raises:
        UserError: If the file is missing, empty or too large, its header is wrong, or a cell
            cannot be read; the line names the file's line and the column.
    """
    with closing(_lines(path)) as lines:  # an error leaves no file open
        return _columns(csv.reader(lines), path)


def _columns(rows: Any, path: Path) -> dict[str, np.ndarray]:
    try:
        names = [name.strip() for name in next(rows, [])]
        if not names:
            raise UserError(f"{path} is empty: name a file with steps")
        check_names(names, str(path))
        columns = {name: array(_PARSERS[kind_of(name)].code) for name in names}
        for cells in rows:
            if cells:  # an empty line has none
                _take(cells, columns, f"{path}, line {rows.line_num}")
    except csv.Error as error:
        raise UserError(f"{path}, line {rows.line_num}: {error}: is this a CSV file?") from error
    if not len(columns[names[0]]):
        raise UserError(f"{path} has no row but its header: name a file with steps")
    found = {name: np.array(column) for name, column in columns.items()}
    flags = {name: found[name].astype(np.bool_) for name in names if kind_of(name) == "flag"}
    return found | flags


def _take(cells: list[str], columns: Mapping[str, array[Any]], where: str) -> None:
    """Append one row to the columns."""
    if len(cells) != len(columns):
        raise UserError(f"{where}: {len(cells)} cells for {len(columns)} columns: restore the file")
    for cell, (name, column) in zip(cells, columns.items(), strict=True):
        parser = _PARSERS[kind_of(name)]
        try:
            column.append(parser.read(cell))
        except (ValueError, KeyError, OverflowError) as error:
            raise UserError(
                f"{where}: column {name} is '{one_line(cell, 40)}', not {parser.name}"
            ) from error


def csv_of(columns: Mapping[str, np.ndarray]) -> bytes:
    """Return columns of equal length as the text of a CSV file.

    A float32 is written as the float64 of the same value, whose shortest text names it exactly.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(_cells(column) for column in columns.values()), strict=True))
    return text.getvalue().encode()


def _cells(column: np.ndarray) -> list[Any]:
    if column.dtype.kind == "b":
        return np.where(column, "true", "false").tolist()
    return column.tolist()


def _lines(path: Path) -> Generator[str, None, None]:
    try:
        if path.is_file() and path.stat().st_size > MOST_BYTES:
            raise UserError(f"{path} is larger than {MOST_BYTES:,} bytes: split it")
        with path.open(encoding="utf-8-sig", newline="") as file:
            yield from file
    except FileNotFoundError as error:
        raise UserError(f"no such file: {path}") from error
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not UTF-8 text: is this a CSV file?") from error
