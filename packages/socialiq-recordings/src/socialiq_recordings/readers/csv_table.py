"""CSV files as typed columns, read in chunks, so that memory holds numbers and not text.

Python's reader is fast enough (see `socialiq bench recordings`) and gives the row of an error.
Frames and recordings of the rows follow from a column, or from periods of observation.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import open_csv
from socialiq_recordings.readers.column_map import ColumnMap
from socialiq_recordings.recording import STEPS

_ROWS = 4_000
_MOST_LINE = 1 << 20
_MISSING = frozenset({"", "nan", "null", "none", "na"})
_ID = re.compile(r"[A-Za-z]{0,3}(-?\d{1,18})(?:\.0*)?")

Words = dict[str, int]


class Table:
    """Columns of a file by our names; texts are numbered.

    Attributes:
        path: The file.
        n_rows: Number of rows, without the header.
        words: Number of each word, for each column of text.
    """

    def __init__(self, path: Path, separator: str, most_rows: int) -> None:
        self.path, self.n_rows = path, 0
        self.words: dict[str, Words] = {}
        self._separator, self._most = separator, most_rows
        self._parts: dict[str, list[np.ndarray]] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a complete column."""
        pieces = self._parts[name]
        if len(pieces) > 1:
            self._parts[name] = [np.concatenate(pieces)]
        return self._parts[name][0]

    def __contains__(self, name: str) -> bool:
        """Whether the column was read."""
        return name in self._parts

    def word(self, name: str, number: int) -> str:
        """Return the word with a number in a column of text."""
        return next(word for word, index in self.words[name].items() if index == number)

    def row_name(self, place: int) -> str:
        """Return the name of a row for messages: the header is row 1."""
        return f"row {place + 2}"

    def read(self, columns: dict[str, str], texts: frozenset[str], whole: frozenset[str]) -> None:
        """Read the file.

        Args:
            columns: The file's names of columns, by our names.
            texts: Names of columns of text; the others are numbers, NaN for an empty cell.
            whole: Names of columns of whole numbers, without empty cells.

        Raises:
            UserError: If the file is missing, empty, too large, lacks a column or has a cell that
                is not a number; the line names the column and the row.
        """
        rows = csv.reader(_lines(self.path), delimiter=self._separator)
        try:
            places = _places(self.path, next(rows, []), columns)
            while chunk := list(islice(rows, _ROWS)):
                self._take(chunk, places, columns, texts, whole)
        except csv.Error as error:
            where = self.row_name(self.n_rows)
            raise UserError(f"{self.path}, after {where}: {error}: is this a CSV file?") from error
        if not self.n_rows:
            raise UserError(f"{self.path} has no row but its header: name a file with states")

    def _take(
        self,
        chunk: list[list[str]],
        places: dict[str, int],
        columns: dict[str, str],
        texts: frozenset[str],
        whole: frozenset[str],
    ) -> None:
        if self.n_rows + len(chunk) > self._most:
            raise UserError(
                f"{self.path} holds more than {self._most:,} states: cut it into recordings, or "
                "raise --most-states where there is memory for them (about 400 bytes each)"
            )
        needed = max(places.values())
        short = next((at for at, row in enumerate(chunk) if len(row) <= needed), None)
        if short is not None:
            raise UserError(
                f"{self.path}, {self.row_name(self.n_rows + short)}: {len(chunk[short])} cells, so "
                "columns are missing: restore the file"
            )
        for name, index in places.items():
            cells = [row[index] for row in chunk]
            if name in texts:
                numbers = self.words.setdefault(name, {})
                column = np.array(
                    [numbers.setdefault(cell, len(numbers)) for cell in cells], np.int32
                )
            elif name in whole:
                column = self._whole(columns[name], cells)
            else:
                column = self._numbers(columns[name], cells)
            self._parts.setdefault(name, []).append(column)
        self.n_rows += len(chunk)

    def _numbers(self, column: str, cells: list[str]) -> np.ndarray:
        try:
            return np.array(list(map(float, cells)))
        except ValueError:
            pass  # A cell is empty or not a number: check each.
        values = np.full(len(cells), np.nan)
        for at, cell in enumerate(cells):
            if cell.strip().lower() not in _MISSING:
                try:
                    values[at] = float(cell)
                except ValueError as error:
                    raise self._no_number(column, at, cell, "a number") from error
        return values

    def _whole(self, column: str, cells: list[str]) -> np.ndarray:
        try:
            return np.array(list(map(int, cells)), np.int64)
        except (ValueError, OverflowError):
            pass
        values = np.zeros(len(cells), np.int64)
        for at, cell in enumerate(cells):
            match = _ID.fullmatch(cell.strip())
            if match is None:
                raise self._no_number(column, at, cell, "a whole number")
            values[at] = int(match[1])
        return values

    def _no_number(self, column: str, at: int, cell: str, what: str) -> UserError:
        return UserError(
            f"{self.path}, {self.row_name(self.n_rows + at)}: {one_line(column, 40)} is "
            f"'{one_line(cell, 40)}', not {what}"
        )


def _lines(path: Path) -> Iterator[str]:
    with open_csv(path) as file:
        while line := file.readline(_MOST_LINE):
            if len(line) == _MOST_LINE:
                raise UserError(f"{path}: a line is longer than 1 MiB: this is not a CSV file")
            yield line


def _places(path: Path, header: list[str], columns: dict[str, str]) -> dict[str, int]:
    if not header:
        raise UserError(f"{path} is empty: name a file with states")
    names = _as_mapped([name.strip() for name in header], columns)
    missing = [column for column in columns.values() if column not in names]
    if missing:
        names_there = one_line(", ".join(names), 300)
        raise UserError(
            f"{path} has no column {', '.join(missing)}: correct the column map; "
            f"the file has {names_there}"
        )
    twice = next((column for column in columns.values() if names.count(column) > 1), None)
    if twice is not None:
        raise UserError(f"{path} has two columns {twice}: name each its own")
    return {name: names.index(column) for name, column in columns.items()}


def _as_mapped(header: list[str], columns: dict[str, str]) -> list[str]:
    """Return the header with the map's names where only the case differs.

    NGSIM's CSV has v_length in one distribution, v_Length in another.
    """
    mapped = {name.lower(): name for name in columns.values() if name not in header}
    return [mapped.get(name.lower(), name) for name in header]


def _beside(path: Path, endings: tuple[str, str]) -> Path:
    if not path.name.endswith(endings[0]):
        raise UserError(
            f"{path}: the column map expects a name that ends in {endings[0]}, to find the file "
            f"that ends in {endings[1]}"
        )
    return path.with_name(path.name.removesuffix(endings[0]) + endings[1])


def rate_of(path: Path, columns: ColumnMap) -> float:
    """Return the frames a second, from the column map or the file that it names.

    Raises:
        UserError: If that file is missing, or does not have exactly one such number.
    """
    if columns.rate_file is None:
        return columns.rate
    rate = _number_beside(path, columns, columns.rate_file[2])
    if not 1 / STEPS[1] <= rate <= 1 / STEPS[0]:
        raise UserError(f"{path}: {columns.rate_file[2]} is not a number of frames a second")
    return rate


def origin_of(path: Path, columns: ColumnMap) -> tuple[float, float] | None:
    """Return the UTM coordinates of the origin of a file's positions, m; None if not known.

    Raises:
        UserError: If the file that the column map names has other things than numbers there.
    """
    if columns.origin is None or columns.rate_file is None:
        return None
    with open_csv(_beside(path, columns.rate_file[:2])) as file:
        header = [name.strip() for name in file.readline(_MOST_LINE).split(columns.separator)]
    if not {*columns.origin} <= {*header}:
        return None
    x, y = (_number_beside(path, columns, column) for column in columns.origin)
    return x, y


def _number_beside(path: Path, columns: ColumnMap, column: str) -> float:
    assert columns.rate_file is not None
    beside = Table(_beside(path, columns.rate_file[:2]), columns.separator, 100)
    beside.read({"number": column}, frozenset(), frozenset())
    numbers = np.unique(beside["number"])
    if len(numbers) != 1 or not np.isfinite(numbers[0]):
        raise UserError(f"{beside.path}: {column} is not one number")
    return float(numbers[0])


def users_of(path: Path, columns: ColumnMap) -> Table | None:
    """Return the file with a row for each track; None if the column map names none.

    Raises:
        UserError: If it is missing, can't be read, or has two rows for a track.
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


_MOST_RECORDINGS = 1_000
_SAME_PERIOD = 10.0  # s; starts this close are those of one period


def recordings_of(
    table: Table, columns: ColumnMap, frame: np.ndarray, dt: float
) -> tuple[np.ndarray, dict[int, str]]:
    """Return the number of each row's recording, and the recordings' names.

    Within a period of observation frames count its time, so their difference is constant.
    """
    group = table["recording"] if "recording" in table else np.zeros(table.n_rows, np.int32)
    names = _names(table, columns)
    if not columns.periods:
        return group, names
    began = np.round(table["time"] * columns.scales["time"] / dt) - frame
    if not np.isfinite(began).all():
        raise UserError(f"{table.path}, {_first(table, ~np.isfinite(began))}: no time")
    starts = np.unique(began)
    period = np.concatenate([[0], np.cumsum(np.diff(starts) > _SAME_PERIOD / dt)])
    pairs = np.column_stack([group, period[np.searchsorted(starts, began)]])
    distinct, group = np.unique(pairs, axis=0, return_inverse=True)
    if len(distinct) > _MOST_RECORDINGS:
        raise UserError(
            f"{table.path}: {len(distinct):,} periods: frames and times have different rates; "
            "correct the rate or the unit of time in the column map"
        )
    several = {word for word in distinct[:, 0].tolist() if (distinct[:, 0] == word).sum() > 1}
    numbers = [(distinct[:at, 0] == word).sum() + 1 for at, word in enumerate(distinct[:, 0])]
    return group.ravel(), {
        at: names[word] + (f"-period-{numbers[at]}" if word in several else "")
        for at, word in enumerate(distinct[:, 0].tolist())
    }


def _names(table: Table, columns: ColumnMap) -> dict[int, str]:
    """Return the names of the recordings: the file's, and the column's word if it has several."""
    stem = table.path.stem
    if columns.users_file is not None:
        stem = table.path.name.removesuffix(columns.users_file[0]).removesuffix(".csv")
    words = table.words.get("recording", {"": 0})
    if len(words) > _MOST_RECORDINGS:
        column = columns.columns["recording"]
        raise UserError(
            f"{table.path}: {len(words):,} recordings by {column}: correct the column map"
        )
    if len(words) == 1:
        return {0: stem}
    return {number: f"{stem}-{one_line(word, 60)}" for word, number in words.items()}


def frames_of(table: Table, columns: ColumnMap, dt: float) -> np.ndarray:
    """Return the numbers of frames, derived from the time if the file has none."""
    if "frame" in table:
        frame = table["frame"]
    else:
        steps = table["time"] * columns.scales["time"] / dt
        if not np.isfinite(steps).all():
            raise UserError(f"{table.path}, {_first(table, ~np.isfinite(steps))}: no time")
        frame = np.round(steps - steps.min()).astype(np.int64)
        off = np.abs(steps - steps.min() - frame) > 0.1
        if off.any():
            raise UserError(
                f"{table.path}, {_first(table, off)}: the time is not a multiple of {dt:g} s after "
                "the first: correct the unit or the rate in the column map"
            )
    low, high = int(frame.min()), int(frame.max())
    return frame if low >= 0 and high < 2**31 else frame - low


def _first(table: Table, bad: np.ndarray) -> str:
    return table.row_name(int(np.argmax(bad)))
