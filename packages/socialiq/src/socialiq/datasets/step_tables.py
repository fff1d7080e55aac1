"""Flat columns of steps as files: CSV, and Parquet through pyarrow (the extra `parquet`).

One row for each step, one column for each number: a vector takes one column for each feature,
`observation_0`, `observation_1`, ... (docs/files.md).

In CSV numbers are written so that they are read back to the bit. Of Parquet only columns of plain
numbers are read. Their types are checked before any of them is read, without unpickling: pyarrow
has made no extension type from a file's pickle since 14.0.1 (CVE-2023-47248). pyarrow's own C++
code parses the file.
"""

import csv
import io
import re
from array import array
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.reading import open_file
from socialiq.storage import open_csv

Kind = Literal["number", "integer", "flag"]
"""Content of a column's cells."""


class Layout(NamedTuple):
    """Columns of a kind of file."""

    # columns of one number for each feature, NAME_0, NAME_1, ...: of the observation and of the
    # next one
    vectors: tuple[str, str]
    action: str  # column of discrete actions; continuous ones take NAME_0, ...
    scalars: Mapping[str, Kind]  # all other columns; among them `r_env` and `r_social`
    reward: str  # the column instead of these two, for a reward of one number a step
    required: tuple[str, ...]  # columns that a file must have beside a reward and actions

    def kind_of(self, name: str) -> Kind | None:
        """Return what the cells of a column hold, or None for an unknown column."""
        if self._feature(name):
            return "number"
        return "integer" if name == self.action else self.scalars.get(name)

    def check_names(self, names: Sequence[str], source: str) -> None:
        """Refuse columns of a file that are unknown, missing or given twice.

        Args:
            names: Names of the columns.
            source: Name of the file in messages.

        Raises:
            UserError: The line names the column and the remedy.
        """
        unknown = [f"'{one_line(name, 60)}'" for name in names if self.kind_of(name) is None]
        if unknown:
            vectors = (f"{vector}_0, ..." for vector in (*self.vectors, self.action))
            columns = ", ".join((*vectors, self.action, *self.scalars))
            raise UserError(
                f"{source} has an unknown column {', '.join(unknown[:5])}: remove or rename it, or "
                f"map a CSV file's columns (--columns); known are {columns}"
            )
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise UserError(f"{source} has two columns {twice}: leave one")
        sizes = {name: self._features(names, name) for name in (*self.vectors, self.action)}
        for vector, numbers in sizes.items():
            gap = next((count for count, number in enumerate(numbers) if count != number), None)
            if gap is not None:
                raise UserError(
                    f"{source} has {vector}_{numbers[-1]} but no column {vector}_{gap}: number the "
                    "columns 0, 1, 2, ..."
                )
        before, after = self.vectors
        if sizes[after] and len(sizes[before]) != len(sizes[after]):
            raise UserError(
                f"{source} has {len(sizes[before])} columns {before}_0, ... and "
                f"{len(sizes[after])} columns {after}_0, ...: give both as many"
            )
        alone = self.reward in names
        missing = [name for name in self.required if name not in names]
        continuous = f"{self.action}_0" in names
        missing += [self.action] if self.action not in names and not continuous else []
        missing += [name for name in ("r_env", "r_social") if name not in names and not alone]
        if missing:
            raise UserError(
                f"{source} has no column {', '.join(missing)}: add it; a reward of one number a "
                f"step is a column {self.reward}, instead of r_env and r_social"
            )
        if continuous and self.action in names:
            raise UserError(
                f"{source} has {self.action} beside {self.action}_0: leave one or the other"
            )
        if alone and ("r_env" in names or "r_social" in names):
            raise UserError(
                f"{source} has {self.reward} beside r_env and r_social: leave one or the other"
            )

    def arrays_of(self, columns: Mapping[str, np.ndarray], source: str) -> dict[str, np.ndarray]:
        """Return arrays by name, with vectors and the reward pair in one array each.

        Args:
            columns: One-dimensional columns by name.
            source: Name of the file in messages.

        Returns:
            Arrays by the names of the layout: vectors (rows, size), the reward (rows, 2), or
            (rows,) if the file has one number a step.

        Raises:
            UserError: If a column is unknown, missing or given twice, or a number is not finite;
                the line names the column and the row.
        """
        self.check_names(list(columns), source)
        for name, column in columns.items():
            if column.dtype.kind == "f" and not (finite := np.isfinite(column)).all():
                raise UserError(
                    f"{source}: column {name}, row {int(np.argmin(finite))}: not finite: leave out "
                    "the episode, or correct its recording"
                )
        single = (*self.scalars, self.action)
        arrays = {name: column for name, column in columns.items() if name in single}
        for vector in (*self.vectors, self.action):
            if size := len(self._features(list(columns), vector)):
                arrays[vector] = np.stack([columns[f"{vector}_{k}"] for k in range(size)], 1)
        if self.reward not in columns:
            pair = arrays.pop("r_env"), arrays.pop("r_social")
            arrays[self.reward] = np.stack(pair, axis=1)
        return arrays

    def _feature(self, name: str) -> re.Match[str] | None:
        return re.fullmatch(
            rf"({'|'.join((*self.vectors, self.action))})_(0|[1-9][0-9]{{0,8}})", name
        )

    def _features(self, names: Sequence[str], vector: str) -> list[int]:
        """Return the numbers of the features that have a column, in rising order."""
        matches = (self._feature(name) for name in names)
        return sorted(int(match[2]) for match in matches if match and match[1] == vector)


STEPS = Layout(
    vectors=("observation", "next_observation"),
    action="action",
    scalars={
        "reward": "number",
        "r_env": "number",
        "r_social": "number",
        "terminated": "flag",
        "truncated": "flag",
        "done": "flag",
        "ending": "integer",
        "mode": "integer",
        "episode": "integer",
        "step": "integer",
    },
    reward="reward",
    required=("observation_0",),
)
"""Demonstrations, under the names of `arrays.of_steps`."""


def columns_of(table: Demonstrations) -> dict[str, np.ndarray]:
    """Return every column of a table under its name in `STEPS`, in a file's order."""
    columns: dict[str, Any] = {}
    for name, values in table.arrays().items():
        if values.ndim == 2:
            columns |= {f"{name}_{number}": column for number, column in enumerate(values.T)}
        else:
            columns[name] = values
    return columns


MOST_BYTES = 2 * 1024**3
"""Largest size of a file, bytes; in memory a cell takes at most 8 bytes."""

_FLAGS = {"true": 1, "false": 0, "1": 1, "0": 0}


def _plain(cell: str) -> str:
    """Return a cell without spaces; Python alone reads 1_000, or digits of other scripts."""
    if "_" in cell or not cell.isascii():
        raise ValueError
    return cell.strip()


class _Cells(NamedTuple):
    """Cells of a column: how text is read, the type in memory, NumPy kinds and names of them."""

    read: Callable[[str], Any]
    code: str
    text: str
    kinds: str
    values: str


_CELLS: dict[Kind | None, _Cells] = {
    "number": _Cells(lambda cell: float(_plain(cell)), "d", "a number", "fiu", "numbers"),
    "integer": _Cells(lambda cell: int(_plain(cell)), "q", "an integer", "iu", "integers"),
    "flag": _Cells(
        lambda cell: _FLAGS[cell.strip().lower()], "b", "true or false", "b", "booleans"
    ),
}


MOST_FAULTS = 3
"""Faults that a refusal names."""


def read_csv(
    path: Path,
    layout: Layout = STEPS,
    mapped: Mapping[str, str] | None = None,
    readers: Mapping[str, Callable[[str], Any]] | None = None,
) -> dict[str, np.ndarray]:
    """Read the columns of a CSV file of steps (UTF-8, comma, first line with the names).

    Args:
        path: The file.
        layout: Columns that it may have.
        mapped: Names of the layout by the file's; further columns are left out. None: the file has
            the names of the layout.
        readers: Functions that read a cell's text as an integer, by names of the layout.

    Raises:
        UserError: If the file is missing, empty or too large, its header is wrong, or cells cannot
            be read; the line names the file's lines and the columns.
    """
    faults = list[str]()
    with open_csv(path) as file:
        if path.is_file() and path.stat().st_size > MOST_BYTES:
            raise UserError(f"{path} is larger than {MOST_BYTES:,} bytes: split it")
        rows = csv.reader(file)
        try:
            names = [name.strip() for name in next(rows, [])]
            if not names:
                raise UserError(f"{path} is empty: name a file with steps")
            if mapped is not None:
                if missing := [name for name in mapped if name not in names]:
                    raise UserError(
                        f"{path} has no column {', '.join(missing)}: correct the column map; the "
                        f"file has {one_line(', '.join(names), 300)}"
                    )
                names = [mapped.get(name, "") for name in names]
            present = [name for name in names if name]
            layout.check_names(present, str(path))
            parsers = {name: _CELLS[layout.kind_of(name)] for name in present}
            for name, read in (readers or {}).items():
                if name in parsers:
                    parsers[name] = _CELLS["integer"]._replace(read=read, text="one of its words")
            columns = {name: array(parser.code) for name, parser in parsers.items()}
            for cells in rows:
                where = f"{path}, line {rows.line_num}"
                if cells and len(cells) != len(names):  # an empty line has none
                    raise UserError(
                        f"{where}: {len(cells)} cells for {len(names)} columns: restore the file"
                    )
                for cell, name in zip(cells, names, strict=False):
                    if not name:
                        continue
                    try:
                        columns[name].append(parsers[name].read(cell))
                    except (ValueError, KeyError, OverflowError):
                        text = one_line(cell, 40)
                        faults.append(
                            f"{where}: column {name} is '{text}', not {parsers[name].text}"
                        )
                if len(faults) >= MOST_FAULTS:
                    break
        except csv.Error as error:
            raise UserError(
                f"{path}, line {rows.line_num}: {error}: is this a CSV file?"
            ) from error
    if faults:
        raise UserError("; ".join(faults[:MOST_FAULTS]))
    if not len(columns[present[0]]):
        raise UserError(f"{path} has no row but its header: name a file with steps")
    arrays = {name: np.array(column) for name, column in columns.items()}
    flags = {name: arrays[name].astype(np.bool_) for name in present if parsers[name].code == "b"}
    return arrays | flags


def csv_of(columns: Mapping[str, np.ndarray]) -> bytes:
    """Return columns of equal length as the text of a CSV file.

    A float32 is written as the float64 of the same value, whose shortest text names it exactly.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    flags = (column.dtype.kind == "b" for column in columns.values())
    cells = (
        (np.where(column, "true", "false") if flag else column).tolist()
        for flag, column in zip(flags, columns.values(), strict=True)
    )
    writer.writerows(zip(*cells, strict=True))
    return text.getvalue().encode()


MOST_NUMBERS = 2**28
"""Largest number of values in all columns of a file."""

_LIBRARY = ("pyarrow.parquet", "parquet", "Parquet files")


def read_parquet(
    path: Path, key: str = "", layout: Layout = STEPS
) -> tuple[dict[str, np.ndarray], bytes | None]:
    """Read the columns of a Parquet file of steps, and the entry `key` of its metadata or None.

    Raises:
        UserError: If the file is missing, damaged or too large, a column is unknown, missing or of
            another type, or a cell is empty; the line names the column.
    """
    parquet = optional(*_LIBRARY)
    with open_file(path) as file:
        try:
            opened = parquet.ParquetFile(file)
            schema = opened.schema_arrow
            size = opened.metadata.num_rows
            layout.check_names(schema.names, str(path))
            if size * len(schema.names) > MOST_NUMBERS:
                raise UserError(f"{path} claims more than {MOST_NUMBERS:,} numbers: split it")
            for field in schema:
                expected = _CELLS[layout.kind_of(field.name)]
                try:
                    kind = np.dtype(field.type.to_pandas_dtype()).kind
                except (NotImplementedError, TypeError):  # nested, or an extension's
                    kind = "O"
                if kind not in expected.kinds:
                    name = one_line(str(field.type), 40)
                    raise UserError(
                        f"{path}: column {field.name} is {name}: write it as {expected.values}"
                    )
            table = opened.read(use_threads=False)
            columns = {name: table.column(name) for name in schema.names}
            for name, column in columns.items():
                if column.null_count:
                    row = int(np.argmax(column.is_null().to_numpy()))
                    raise UserError(
                        f"{path}: column {name}, row {row} is empty: fill it or leave out the row"
                    )
            arrays = {name: column.to_numpy() for name, column in columns.items()}
            return arrays, (schema.metadata or {}).get(key.encode())
        except UserError:
            raise
        # pyarrow's errors are these, or descend from them.
        except (OSError, ValueError, KeyError, TypeError, RuntimeError, MemoryError) as error:
            raise UserError(f"{path} is damaged or no Parquet file: write it again") from error


def parquet_of(columns: Mapping[str, np.ndarray], key: str, entry: bytes) -> bytes:
    """Return columns as the bytes of a Parquet file.

    Args:
        columns: Columns of equal length, by name.
        key: Name of the metadata entry.
        entry: Bytes of the metadata entry.

    Raises:
        UserError: If the extra `parquet` is not installed.
    """
    parquet = optional(*_LIBRARY)
    import pyarrow  # pyright: ignore[reportMissingImports]

    table = pyarrow.table({name: np.ascontiguousarray(column) for name, column in columns.items()})
    file = io.BytesIO()
    parquet.write_table(table.replace_schema_metadata({key: entry}), file)
    return file.getvalue()
