"""Flat columns of steps as Parquet, through pyarrow (the extra `parquet`).

Only columns of plain numbers are read. Their types are checked before any of them is read, and
nothing is unpickled: pyarrow has made no extension type from a file's pickle since 14.0.1
(CVE-2023-47248). pyarrow's own C++ code parses the file.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from socialiq.datasets.step_columns import Kind, check_names, kind_of
from socialiq.errors import UserError
from socialiq.foreign import one_line

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
    try:
        import pyarrow.parquet  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UserError(
            "Parquet needs pyarrow, which is not installed: pip install 'socialiq[parquet]'"
        ) from error
    return pyarrow.parquet


def read_parquet(path: Path, key: str) -> tuple[dict[str, np.ndarray], bytes | None]:
    """Read the columns of a Parquet file of steps.

    Args:
        path: The file.
        key: Name of an entry of the file's own metadata.

    Returns:
        The columns, and that entry or None.

    Raises:
        UserError: If the file is missing, damaged or too large, a column is unknown, missing or of
            another type, or a cell is empty; the line names the column.
    """
    parquet = _library()
    if not path.is_file():
        raise UserError(f"no such file: {path}")
    try:
        with path.open("rb") as file:
            opened = parquet.ParquetFile(file)
            schema, size = opened.schema_arrow, opened.metadata.num_rows
            check_names(schema.names, str(path))
            if size * len(schema.names) > MOST_NUMBERS:
                raise UserError(f"{path} claims more than {MOST_NUMBERS:,} numbers: split it")
            for field in schema:
                _check_type(field, path)
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


def _check_type(field: Any, path: Path) -> None:
    kinds, wanted = _WANTED[kind_of(field.name)]
    try:
        kind = np.dtype(field.type.to_pandas_dtype()).kind
    except (NotImplementedError, TypeError):  # nested, or an extension's
        kind = "O"
    if kind not in kinds:
        told = one_line(str(field.type), 40)
        raise UserError(f"{path}: column {field.name} is {told}: write it as {wanted}")


def _column(table: Any, name: str, path: Path) -> np.ndarray:
    column = table.column(name)
    if column.null_count:
        row = int(np.argmax(column.is_null().to_numpy()))
        raise UserError(f"{path}: column {name}, row {row} is empty: fill it or leave out the row")
    return column.to_numpy()
