"""Flat columns of steps as files: CSV, and Parquet through pyarrow (the extra `parquet`).

In CSV numbers are written so that they are read back to the bit. Of Parquet only columns of plain
numbers are read. Their types are checked before any of them is read, and nothing is unpickled:
pyarrow has made no extension type from a file's pickle since 14.0.1 (CVE-2023-47248). pyarrow's own
C++ code parses the file.
"""

from __future__ import annotations

import csv
import io
from array import array
from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from socialiq.datasets.step_columns import STEPS, Kind, Layout
from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import open_file
from socialiq.storage import open_csv

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


def read_csv(path: Path, layout: Layout = STEPS) -> dict[str, np.ndarray]:
    """Read the columns of a CSV file of steps (UTF-8, comma, first line with the names).

    Args:
        path: The file.
        layout: Its columns.

    Raises:
        UserError: If the file is missing, empty or too large, its header is wrong, or a cell
            cannot be read; the line names the file's line and the column.
    """
    with closing(_lines(path)) as lines:  # an error leaves no file open
        return _columns(csv.reader(lines), layout, path)


def _columns(rows: Any, layout: Layout, path: Path) -> dict[str, np.ndarray]:
    try:
        names = [name.strip() for name in next(rows, [])]
        if not names:
            raise UserError(f"{path} is empty: name a file with steps")
        layout.check_names(names, str(path))
        parsers = {name: _PARSERS[layout.kind_of(name)] for name in names}
        columns = {name: array(parser.code) for name, parser in parsers.items()}
        for cells in rows:
            if cells:  # an empty line has none
                _take(cells, parsers, columns, f"{path}, line {rows.line_num}")
    except csv.Error as error:
        raise UserError(f"{path}, line {rows.line_num}: {error}: is this a CSV file?") from error
    if not len(columns[names[0]]):
        raise UserError(f"{path} has no row but its header: name a file with steps")
    found = {name: np.array(column) for name, column in columns.items()}
    flags = {name: found[name].astype(np.bool_) for name in names if parsers[name].code == "b"}
    return found | flags


def _take(
    cells: list[str], parsers: Mapping[str, _Parser], columns: Mapping[str, Any], where: str
) -> None:
    """Append one row to the columns."""
    if len(cells) != len(columns):
        raise UserError(f"{where}: {len(cells)} cells for {len(columns)} columns: restore the file")
    for cell, (name, parser) in zip(cells, parsers.items(), strict=True):
        try:
            columns[name].append(parser.read(cell))
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
    with open_csv(path) as file:
        if path.is_file() and path.stat().st_size > MOST_BYTES:
            raise UserError(f"{path} is larger than {MOST_BYTES:,} bytes: split it")
        yield from file


MOST_NUMBERS = 2**28
"""Largest number of values in all columns of a file."""

_WANTED: dict[Kind | None, tuple[str, str]] = {
    "number": ("fiu", "numbers"),
    "integer": ("iu", "integers"),
    "flag": ("b", "booleans"),
}
"""By kind of column: the NumPy kinds that are read, and their name in messages."""


def _library() -> ModuleType:
    """Import pyarrow's Parquet module.

    Raises:
        UserError: If it is not installed.
    """
    return optional("pyarrow.parquet", "parquet", "Parquet files")


def read_parquet(
    path: Path, key: str = "", layout: Layout = STEPS
) -> tuple[dict[str, np.ndarray], bytes | None]:
    """Read the columns of a Parquet file of steps.

    Args:
        path: The file.
        key: Name of an entry of the file's own metadata.
        layout: Its columns.

    Returns:
        The columns, and that entry or None.

    Raises:
        UserError: If the file is missing, damaged or too large, a column is unknown, missing or of
            another type, or a cell is empty; the line names the column.
    """
    parquet = _library()
    with open_file(path) as file:
        try:
            opened = parquet.ParquetFile(file)
            schema, size = opened.schema_arrow, opened.metadata.num_rows
            layout.check_names(schema.names, str(path))
            if size * len(schema.names) > MOST_NUMBERS:
                raise UserError(f"{path} claims more than {MOST_NUMBERS:,} numbers: split it")
            for field in schema:
                _check_type(field, layout.kind_of(field.name), path)
            table = opened.read(use_threads=False)
            columns = {name: _column(table, name, path) for name in schema.names}
            return columns, (schema.metadata or {}).get(key.encode())
        except UserError:
            raise
        # pyarrow's errors are these, or descend from them.
        except (OSError, ValueError, KeyError, TypeError, RuntimeError, MemoryError) as error:
            raise UserError(f"{path} is damaged or no Parquet file: write it again") from error


def parquet_of(columns: Mapping[str, np.ndarray], key: str, entry: bytes) -> bytes:
    """Return columns of equal length as the bytes of a Parquet file with one metadata entry.

    Raises:
        UserError: If pyarrow is not installed.
    """
    parquet = _library()
    import pyarrow  # pyright: ignore[reportMissingImports]

    table = pyarrow.table({name: np.ascontiguousarray(column) for name, column in columns.items()})
    file = io.BytesIO()
    parquet.write_table(table.replace_schema_metadata({key: entry}), file)
    return file.getvalue()


def _check_type(field: Any, wanted_kind: Kind | None, path: Path) -> None:
    kinds, wanted = _WANTED[wanted_kind]
    try:
        kind = np.dtype(field.type.to_pandas_dtype()).kind
    except (NotImplementedError, TypeError):  # nested, or an extension's
        kind = "O"
    if kind not in kinds:
        found = one_line(str(field.type), 40)
        raise UserError(f"{path}: column {field.name} is {found}: write it as {wanted}")


def _column(table: Any, name: str, path: Path) -> np.ndarray:
    column = table.column(name)
    if column.null_count:
        row = int(np.argmax(column.is_null().to_numpy()))
        raise UserError(f"{path}: column {name}, row {row} is empty: fill it or leave out the row")
    return column.to_numpy()
