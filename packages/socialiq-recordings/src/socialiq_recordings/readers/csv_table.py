"""CSV files as typed columns, read in chunks, so that memory holds numbers and not text.

Python's reader is fast enough (see `socialiq bench recordings`) and gives the row of an error.
Frames and recordings of the rows follow from a column, or from periods of observation.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import open_csv
from socialiq_recordings.readers.column_map import ColumnMap
from socialiq_recordings.readers.tracks import STEPS

_ROWS = 4_000
_MOST_LINE = 1 << 20
_MISSING = frozenset({"", "nan", "null", "none", "na"})
_WHOLE = re.compile(r"(-?\d{1,18})(?:\.0*)?", re.ASCII)
_LETTERS = re.compile(r"[A-Za-z]{1,3}(\d{1,18})", re.ASCII)
_LARGEST = 10**18  # numbers that are not below are words
_NO_NUMBER = -(2**63)  # of a cell that should be a whole number, until its row is dropped
_FIRST_WORD = -(2**62)  # code of the first word among ids; the others go down from it


Names = dict[str, str]  # the file's names of columns, by ours
Kinds = frozenset[str]  # our names of the columns of a kind


class Table:
    """Columns of a file by our names; texts are numbered, rows that can't be read are dropped."""

    def __init__(
        self, path: Path, separator: str, most_rows: int, codes: dict[str, int] | None = None
    ) -> None:
        self.path = path
        self.n_rows = 0
        self.dropped = 0
        # Of each word in the column `id`; tables of one recording share it.
        self.codes: dict[str, int] = {} if codes is None else codes
        self.words: dict[str, dict[str, int]] = {}  # number of each word, by column
        self.faults: dict[int, str] = {}  # of the first row dropped, by `id`
        self._separator = separator
        self._most = most_rows
        self._columns: dict[str, list[np.ndarray]] = {}
        self._numbers = np.zeros(0, np.int64)
        self._bad: dict[int, str] = {}
        self._blank: list[int] = []

    def __getitem__(self, name: str) -> np.ndarray:
        return self._columns[name][0]

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def word(self, name: str, number: int) -> str:
        """Return the word with a number in a column of text.

        Args:
            name: Our name of the column.
            number: Number that the table has in the place of the word.
        """
        return next(word for word, index in self.words[name].items() if index == number)

    def row_name(self, row: int | np.integer) -> str:
        """Return the name of a row, as the beginning of a message; the header is row 1."""
        return f"row {self._numbers[row] + 2}: "

    def read(
        self, columns: Names, texts: Kinds, integers: Kinds, optional: tuple[str, ...] = ()
    ) -> None:
        """Read columns of the file.

        Columns that are neither texts nor whole numbers are numbers, NaN for an empty cell.

        Args:
            columns: The file's names of the columns, by ours.
            texts: Our names of the columns of text, whose words are numbered.
            integers: Our names of the columns of whole numbers.
            optional: The file's names of columns that it may lack.

        Raises:
            UserError: If the file is missing, empty, too large or lacks a column, or more than half
                of its rows can't be read; the line names the first such row.
        """
        rows = csv.reader(_lines(self.path), delimiter=self._separator)
        try:
            header = next(rows, [])
            if not header:
                raise UserError(f"{self.path} is empty: name a file with states")
            header = [name.strip() for name in header]
            mapped = {name.lower(): name for name in columns.values() if name not in header}
            names = [mapped.get(name.lower(), name) for name in header]
            columns = {n: c for n, c in columns.items() if c in names or c not in optional}
            missing = [column for column in columns.values() if column not in names]
            if missing:
                raise UserError(
                    f"{self.path} has no column {', '.join(missing)}: correct the column map; "
                    f"the file has {one_line(', '.join(names), 300)}"
                )
            twice = next((column for column in columns.values() if names.count(column) > 1), None)
            if twice is not None:
                raise UserError(f"{self.path} has two columns {twice}: name each its own")
            places = {name: names.index(column) for name, column in columns.items()}
            while chunk := list(islice(rows, _ROWS)):
                self._take(chunk, places, columns, texts, integers)
        except csv.Error as error:
            row = f"row {self.n_rows + 2}"
            raise UserError(f"{self.path}, after {row}: {error}: is this a CSV file?") from error
        if self.n_rows == len(self._blank):
            raise UserError(f"{self.path} has no row but its header: name a file with states")
        self._columns = {name: [np.concatenate(pieces)] for name, pieces in self._columns.items()}
        self._numbers = np.arange(self.n_rows)
        stays = np.ones(self.n_rows, bool)
        stays[self._blank] = False
        row_now = self._keep(stays)
        self.drop({int(row_now[row]): fault for row, fault in self._bad.items()})

    def drop(self, faults: Mapping[int, str]) -> np.ndarray:
        """Drop rows, by the fault of each; return whether each row stays.

        Raises:
            UserError: If they are more than half; the line has the first.
        """
        stays = np.ones(self.n_rows, bool)
        for row, fault in faults.items():
            fault = f"{self.row_name(row)}{fault}"
            if 2 * len(faults) > self.n_rows:
                raise UserError(f"{self.path}, {fault}")
            if "id" in self:
                self.faults.setdefault(int(self["id"][row]), fault)
            stays[row] = False
        self._keep(stays)
        self.dropped += len(faults)
        return stays

    def _keep(self, stays: np.ndarray) -> np.ndarray:
        """Keep these rows, and return the new number of each."""
        if not stays.all():
            self._columns = {name: [self[name][stays]] for name in self._columns}
            self._numbers = self._numbers[stays]
            self.n_rows = int(stays.sum())
        return np.cumsum(stays) - 1

    def _take(
        self, chunk: list[list[str]], places: dict[str, int], columns: Names, *kinds: Kinds
    ) -> None:
        if self.n_rows + len(chunk) > self._most:
            raise UserError(
                f"{self.path} holds more than {self._most:,} states: cut it into recordings, or "
                "raise --most-states where there is memory for them (about 400 bytes each)"
            )
        texts, integers = kinds
        needed = max(places.values()) + 1
        for at, row in enumerate(chunk):
            if not any(row) or (len(row) < needed and not any(cell.strip() for cell in row)):
                self._blank.append(self.n_rows + at)
                chunk[at] = ["0"] * needed
            elif len(row) < needed:
                self._bad[self.n_rows + at] = f"{len(row)} cells, so columns are missing"
                chunk[at] = row + [""] * needed
        for name, index in places.items():
            cells = [row[index] for row in chunk]
            if name in texts:
                numbers = self.words.setdefault(name, {})
                codes = [numbers.setdefault(cell, len(numbers)) for cell in cells]
                column = np.array(codes, np.int32)
            else:
                column = self._parsed(columns[name], cells, name in integers, name == "id")
            self._columns.setdefault(name, []).append(column)
        self.n_rows += len(chunk)

    def _parsed(self, column: str, cells: list[str], is_integer: bool, is_name: bool) -> np.ndarray:
        every = "".join(cells)
        try:
            if "_" in every or not every.isascii():
                raise ValueError  # Python reads 1_000 and digits of other scripts as numbers.
            if not is_integer:
                return np.array(list(map(float, cells)))
            numbers = np.array(list(map(int, cells)), np.int64)
            if np.abs(numbers).max() < _LARGEST:
                return numbers
        except (ValueError, OverflowError):
            pass  # A cell is empty or not a number: check each.
        no_number = np.int64(_NO_NUMBER) if is_integer else np.float64(np.nan)
        values = np.full(len(cells), no_number)
        for at, cell in enumerate(map(str.strip, cells)):
            match = _WHOLE.fullmatch(cell)
            missing = cell.lower() in _MISSING
            if is_integer and match is not None:
                values[at] = int(match[1])
            elif is_name and not missing and at + self.n_rows not in self._bad:
                values[at] = self.codes.setdefault(cell, _FIRST_WORD - len(self.codes))
            elif is_integer or not (missing or _is_number(cell)):
                what = "a name" if is_name else "a whole number" if is_integer else "a number"
                fault = f"{one_line(column, 40)} is '{one_line(cell, 40)}', not {what}"
                self._bad.setdefault(self.n_rows + at, fault)
            elif not missing:
                values[at] = float(cell)
        return values

    def renumber(self, numbers: Mapping[str, int]) -> None:
        """Replace the codes of the words among ids by numbers."""
        column = self["id"]
        number_of = {code: numbers[word] for word, code in self.codes.items()}
        for row in np.flatnonzero(column <= _FIRST_WORD):
            column[row] = number_of[int(column[row])]
        self.faults = {number_of.get(name, name): fault for name, fault in self.faults.items()}


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return cell.isascii() and "_" not in cell


def number_words(tables: Sequence[Table]) -> dict[str, int]:
    """Number the words among the ids of tables that share their codes, and return the numbers.

    A word such as P12 gets the number in it, if that is no other road user's too; otherwise all
    words get numbers after the largest, in their order.
    """
    words = tables[0].codes
    if not words:
        return {}
    ids = np.unique(np.concatenate([table["id"] for table in tables]))
    plain = ids[ids > _FIRST_WORD].tolist()
    matches = [_LETTERS.fullmatch(word) for word in words]
    numbers = [int(match[1]) for match in matches if match is not None]
    if len({*numbers, *plain}) < len(words) + len(plain):
        first = max(plain, default=0) + 1
        numbers = list(range(first, first + len(words)))
    numbered = dict(zip(words, numbers, strict=True))
    for table in tables:
        table.renumber(numbered)
    return numbered


def _lines(path: Path) -> Iterator[str]:
    with open_csv(path) as file:
        while line := file.readline(_MOST_LINE):
            if len(line) == _MOST_LINE:
                raise UserError(f"{path}: a line is longer than 1 MiB: this is not a CSV file")
            yield line


def beside(path: Path, endings: tuple[str, str]) -> Path:
    """Return the file whose name has the second ending in place of the first.

    Args:
        path: The file with the first ending.
        endings: Endings of the names of both files.

    Returns:
        A path in the same folder; the file may not exist.

    Raises:
        UserError: If the name of the file has another ending.
    """
    if not path.name.endswith(endings[0]):
        expected = f"{path}: the column map expects a name that ends in {endings[0]}"
        raise UserError(f"{expected}, to find the file that ends in {endings[1]}")
    return path.with_name(path.name.removesuffix(endings[0]) + endings[1])


def rate_of(path: Path, columns: ColumnMap) -> float:
    """Return the frames a second, from the column map or the file that it names.

    Args:
        path: The file with the states.
        columns: Its column map.

    Raises:
        UserError: If the file that the map names can't be read, or has not one rate in the range.
    """
    if columns.rate_file is None:
        return columns.rate
    rate = _number_beside(path, columns, columns.rate_file[2])
    if not 1 / STEPS[1] <= rate <= 1 / STEPS[0]:
        raise UserError(f"{path}: {columns.rate_file[2]} is not a number of frames a second")
    return rate


def origin_of(path: Path, columns: ColumnMap) -> tuple[float, float] | None:
    """Return the UTM coordinates of the origin of a file's positions, m; None if not known.

    Args:
        path: The file with the states.
        columns: Its column map, which names the file and the columns with the origin.

    Returns:
        Easting and northing. None if the map names no such columns, or the file lacks them.

    Raises:
        UserError: If that file can't be read, or a column has not one number.
    """
    if columns.origin is None or columns.rate_file is None:
        return None
    with open_csv(beside(path, columns.rate_file[:2])) as file:
        header = [name.strip() for name in file.readline(_MOST_LINE).split(columns.separator)]
    if not {*columns.origin} <= {*header}:
        return None
    x, y = (_number_beside(path, columns, column) for column in columns.origin)
    return x, y


def _number_beside(path: Path, columns: ColumnMap, column: str) -> float:
    assert columns.rate_file is not None
    table = Table(beside(path, columns.rate_file[:2]), columns.separator, 100)
    table.read({"number": column}, frozenset(), frozenset())
    numbers = np.unique(table["number"])
    if len(numbers) != 1 or not np.isfinite(numbers[0]):
        raise UserError(f"{table.path}: {column} is not one number")
    return float(numbers[0])


_MOST_RECORDINGS = 20_000  # a file of INTERACTION 1.2 has thousands of cases
_SAME_PERIOD = 10.0  # s; starts this close are those of one period


def recordings_of(
    table: Table, columns: ColumnMap, frame: np.ndarray, dt: float
) -> tuple[np.ndarray, dict[int, str]]:
    """Return the number of each row's recording, and the recordings' names.

    Within a period of observation frames count its time, so their difference is constant.

    Args:
        table: Table of the states.
        columns: Its column map.
        frame: Frame of each row.
        dt: Time between frames, s.

    Returns:
        The number of each row's recording, and the name of each recording by its number. A name is
        that of the file, with the column's word if the file has several.

    Raises:
        UserError: If there are more than 20,000 recordings.
    """
    stem = table.path.stem
    if columns.users_file is not None:
        stem = table.path.name.removesuffix(columns.users_file[0]).removesuffix(".csv")
    group = np.zeros(table.n_rows, np.int32)
    names = {0: stem}
    if "recording" in table:
        group = table["recording"]
        numbers = np.unique(group).tolist()
        if len(numbers) > _MOST_RECORDINGS:
            column = columns.columns["recording"]
            raise UserError(
                f"{table.path}: {len(numbers):,} recordings by {column}: correct the column map"
            )
        names = {n: f"{stem}-{one_line(table.word('recording', n), 60)}" for n in numbers}
        names = names if len(names) > 1 else {numbers[0]: stem}
    if not columns.periods:
        return group, names
    began = np.round(table["time"] * columns.scales["time"] / dt) - frame
    starts = np.unique(began)
    period = np.concatenate([[0], np.cumsum(np.diff(starts) > _SAME_PERIOD / dt)])
    pairs = np.column_stack([group, period[np.searchsorted(starts, began)]])
    distinct, group = np.unique(pairs, axis=0, return_inverse=True)
    if len(distinct) > _MOST_RECORDINGS:
        raise UserError(
            f"{table.path}: {len(distinct):,} periods: frames and times have different rates; "
            "correct the rate or the unit of time in the column map"
        )
    of_word = distinct[:, 0]
    recordings = {}
    for at, word in enumerate(of_word.tolist()):
        several = (of_word == word).sum() > 1
        number = (of_word[:at] == word).sum() + 1
        recordings[at] = names[word] + (f"-period-{number}" if several else "")
    return group.ravel(), recordings


def frames_of(table: Table, columns: ColumnMap, dt: float) -> np.ndarray:
    """Return the numbers of frames, derived from the time if the file has none.

    Rows without a time, and those whose time fits no frame, are dropped from the table.

    Args:
        table: Table of the states, which has times or frames.
        columns: Its column map, with the unit of time.
        dt: Time between frames, s.

    Returns:
        A number for each row that stays. Numbers that are negative or too large for 31 bits are
        shifted so that the first is 0.

    Raises:
        UserError: If more than half of the rows are dropped.
    """
    if "time" in table:
        bad = np.flatnonzero(~np.isfinite(table["time"])).tolist()
        table.drop(dict.fromkeys(bad, "no time"))
    if "frame" in table:
        frame = table["frame"]
    else:
        steps = table["time"] * columns.scales["time"] / dt
        frame = np.round(steps - steps.min()).astype(np.int64)
        off = np.flatnonzero(np.abs(steps - steps.min() - frame) > 0.1).tolist()
        fault = f"the time is not a multiple of {dt:g} s after the first: correct the unit or the "
        frame = frame[table.drop(dict.fromkeys(off, f"{fault}rate in the column map"))]
    low = int(frame.min())
    return frame if low >= 0 and frame.max() < 2**31 else frame - low
