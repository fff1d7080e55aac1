"""Reader of recordings in CSV files of any layout, by a column map."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.physics import wrapped_heading
from socialiq.reading import sha256_of_file
from socialiq_recordings.readers import csv_table, tracks
from socialiq_recordings.readers.column_map import COLUMNS, ColumnMap
from socialiq_recordings.readers.csv_table import Table
from socialiq_recordings.recording import FARTHEST, Imported, RoadUser
from socialiq_recordings.road.network import Refused, RoadNetwork

_NAMED = 100  # rows that are dropped and named, of different road users
_LARGEST_HEADING = 2.2 * np.pi  # rad; a heading of a tenth more than a turn is in degrees


def read_csv(
    path: Path,
    columns: ColumnMap,
    most_states: int = tracks.MOST_STATES,
    road: RoadNetwork | None = None,
    stated: Mapping[str, Any] | None = None,
) -> list[Imported]:
    """Read the recordings of a CSV file; rows that can't be read are dropped and counted.

    Args:
        path: The file.
        columns: Its column map.
        most_states: Most rows that are read.
        road: Road whose lanes give standing vehicles their heading; None for no road.
        stated: Entries that are added to the provenance; with them the origin of the file is not
            read.

    Raises:
        UserError: If a file is missing, empty, lacks a column or has too many rows, more than half
            of its rows have a fault, or no track can be used; the line has the row or the id.
    """
    table = Table(path, columns.separator, most_states)
    texts = frozenset({"recording", "class"})
    whole = frozenset({"id", "frame"})
    table.read(columns.columns, texts, whole, columns.optional)
    if lacks := columns.lacking([name for name in COLUMNS if name in table]):
        raise UserError(
            f"{path} lacks {', '.join(lacks)}: correct the column map, which makes it optional"
        )
    dt = 1 / csv_table.rate_of(path, columns)
    frame = csv_table.frames_of(table, columns, dt)
    users = None
    if columns.users_file is not None:
        beside = csv_table.beside(path, columns.users_file)
        users = Table(beside, columns.separator, 10_000_000, table.codes)
        users.read(columns.users_columns, texts, whole)
    words = csv_table.number_words([table] if users is None else [table, users])
    name_of = {number: word for word, number in words.items()}
    source: dict[str, Any] = {"format": columns.format, "file": path.name}
    source |= {"sha256": sha256_of_file(path), "licence": columns.licence}
    origin = csv_table.origin_of(path, columns)
    if stated:
        source |= stated
    elif origin is not None:
        source |= {"utm_origin": list(origin)}
    group, names = csv_table.recordings_of(table, columns, frame, dt)
    order = np.argsort(group, kind="stable")
    numbers, starts = np.unique(group[order], return_index=True)
    recordings = []
    for number, rows in zip(numbers.tolist(), np.split(order, starts[1:]), strict=True):
        gathered = tracks.Gathered(path)
        draft = _Draft(table, columns, users, frame, dt, road or RoadNetwork(), name_of, gathered)
        if not recordings:
            gathered.note("row", table.dropped)
            gathered.faults += [
                Refused(name_of.get(user, str(user)), fault)
                for user, fault in itertools.islice(table.faults.items(), _NAMED)
            ]
        draft.gather(rows)
        ids = [id for id in np.unique(table["id"][rows]).tolist() if id in name_of]
        words_of = {"track_ids": {str(id): one_line(name_of[id], 60) for id in ids}} if ids else {}
        recordings.append(gathered.imported(names[number], dt, source | words_of, draft.road))
    return recordings


class _NeverMovesError(Exception):
    """A track without a heading never moves."""


@dataclass
class _Draft:
    """Builder of a recording from some rows of a table."""

    table: Table
    columns: ColumnMap
    users: Table | None
    frame: np.ndarray
    dt: float
    road: RoadNetwork
    name_of: dict[int, str]
    gathered: tracks.Gathered
    direction_at: Callable[[float, float], float | None] | None = None

    def gather(self, rows: np.ndarray) -> None:
        self.gathered.n_states = len(rows)
        rows = self._distinct(rows)
        # By track, and the first row of each.
        identity = self.table["id"][rows]
        order = np.argsort(identity, kind="stable")
        if self.columns.any_order:
            order = np.lexsort((self.frame[rows], identity))
        rows = rows[order]
        identity = identity[order]
        new = np.diff(identity) != 0
        if self.columns.repeated_ids:
            new |= np.diff(self.frame[rows]) > 1
        starts = np.concatenate([[0], np.flatnonzero(new) + 1, [len(rows)]]).tolist()
        table = self.table
        scales = self.columns.scales
        if "heading" in table:
            heading = table["heading"][rows]
            far = np.abs(heading * scales["heading"]) > _LARGEST_HEADING
            if 2 * far.sum() > len(rows):
                row = int(np.argmax(far))
                raise UserError(
                    f"{table.path}, {table.row_name(rows[row])}the heading is {heading[row]:g}, "
                    "more than a turn: these are degrees; say so in the column map's [units]"
                )
        if "time" in table and "frame" in table:
            inside = np.ones(len(rows) - 1, bool)
            inside[np.flatnonzero(new)] = False
            off = inside & self._off_time(rows)
            if 2 * off.sum() > inside.sum():
                row = int(np.argmax(off))
                raise UserError(f"{table.path}, {self._time_fault(rows[row : row + 2])}")
        read: dict[int, tuple[np.ndarray, tracks.User, np.ndarray]] = {}
        standing = []

        def take(first: int, end: int) -> None:
            track = rows[first:end]
            user = None
            try:
                user = self._user(track)
                read[first] = track, user, self._states(track, user)
            except _NeverMovesError:
                standing.append((first, end))
            except ValueError as error:
                self.gathered.refuse(self._name(track), error, None if user is None else user[0])

        for first, end in itertools.pairwise(starts):
            take(first, end)
        if standing:
            states = [columns for _, _, columns in read.values()]
            self.direction_at = tracks.directions(self.road, states)
        for first, end in tuple(standing):
            take(first, end)
        for first in sorted(read):
            track, user, states = read[first]
            self.gathered.add(int(identity[first]), user, self.frame[track], states)

    def _name(self, track: np.ndarray) -> str:
        """Return the road user's name in the file."""
        identity = int(self.table["id"][track[0]])
        return self.name_of.get(identity, str(identity))

    def _distinct(self, rows: np.ndarray) -> np.ndarray:
        """Return the rows without exact repetitions of a state, which are counted."""
        identity = self.table["id"][rows]
        frame = self.frame[rows]
        order = np.lexsort((rows, frame, identity))
        again = np.append(False, (np.diff(identity[order]) == 0) & (np.diff(frame[order]) == 0))
        if not again.any():
            return rows
        names = [name for name in COLUMNS if name in self.table]
        states = np.stack([self.table[name][rows[order]].astype(np.float64) for name in names])
        again &= tracks.repeated(frame[order], states)
        self.gathered.note("repeated row", int(again.sum()))
        return np.sort(rows[order[~again]])

    def _off_time(self, rows: np.ndarray) -> np.ndarray:
        """Return whether the time of each row but the first differs from that of its frame."""
        time = np.diff(self.table["time"][rows]) * self.columns.scales["time"]
        return ~(np.abs(time - np.diff(self.frame[rows]) * self.dt) < self.dt / 2)

    def _time_fault(self, rows: np.ndarray) -> str:
        seconds = float(np.diff(self.table["time"][rows])[0]) * self.columns.scales["time"]
        return (
            f"{self.table.row_name(rows[1])}{seconds:g} s after the frame before, with frames "
            f"{self.dt:g} s apart: correct the rate or the unit of time in the column map"
        )

    def _user(self, track: np.ndarray) -> tracks.User:
        """Return class, length and width of a track, from its rows or the second file."""
        rows = track
        if self.users is not None:
            rows = np.flatnonzero(self.users["id"] == self.table["id"][track[0]])
            if len(rows) != 1:
                raise ValueError(f"{self.users.path.name} has {len(rows)} rows of it, not one")

        def cells(name: str) -> tuple[Table, np.ndarray]:
            if self.users is not None and name in self.users:
                return self.users, rows
            return self.table, track

        table, at = cells("class")
        codes = table["class"][at] if "class" in table else np.zeros(0, np.int32)
        numbers, first = np.unique(codes, return_index=True)
        words = [
            table.word("class", number).strip() for number in numbers[np.argsort(first)].tolist()
        ]
        if self.columns.default_class:
            words = [word for word in words if word] or [self.columns.default_class]
        # Rows without a known class have that of the others.
        words = [word for word in words if word in self.columns.classes] or words
        word = words[0]
        if len({*words}) > 1:
            raise ValueError(f"its class changes from '{word}': give each road user its own id")
        kind = self.columns.classes.get(word, RoadUser.OTHER)
        sizes = []
        for side in ("length", "width"):
            table, at = cells(side)
            values = table[side][at] if side in table else np.zeros(0)
            good = values[np.isfinite(values)] * self.columns.scales["size"]
            sizes.append(float(np.median(good)) if len(good) else 0.0)
        if min(sizes) <= 0:
            if word not in self.columns.default_sizes:
                raise ValueError(f"it has no size, nor has {kind.name.lower()} a default")
            sizes = self.columns.default_sizes[word]
        if word not in self.columns.classes:
            fault = f"class '{one_line(word, 40)}' is not in the column map's [classes]"
            self.gathered.unknown(self._name(track), f"{table.row_name(at[0])}{fault}")
        return int(kind), float(sizes[0]), float(sizes[1])

    def _states(self, track: np.ndarray, user: tracks.User) -> np.ndarray:
        """Return five rows: x, y, heading, vx, vy."""
        table = self.table
        kind, length, width = user
        try:
            tracks.check_frames(self.frame[track], lambda row: table.row_name(track[row]))
        except ValueError as error:
            # A row that was dropped leaves a gap.
            raise ValueError(table.faults.get(int(table["id"][track[0]]), error)) from error
        if "time" in table and "frame" in table and self._off_time(track).any():
            row = int(np.argmax(self._off_time(track)))
            raise ValueError(self._time_fault(track[row : row + 2]))
        up = -1.0 if self.columns.y_down else 1.0
        x, y = (table[axis][track] * self.columns.scales["position"] for axis in "xy")
        self._check("x or y", track, x + y)
        if self.columns.point == "corner":
            # The upper left corner of an axis-parallel box, with y as in the file.
            x = x + length / 2
            y = y + width / 2 * -up
        y = up * y
        heading, vx, vy = self._motion(track, x, y, kind == RoadUser.PEDESTRIAN)
        if self.columns.point == "front":
            x = x - length / 2 * np.cos(heading)
            y = y - length / 2 * np.sin(heading)
        return np.stack([x, y, heading, vx, vy])

    def _motion(
        self, track: np.ndarray, x: np.ndarray, y: np.ndarray, walks: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        table = self.table
        scales = self.columns.scales
        up = -1.0 if self.columns.y_down else 1.0
        vx, vy = tracks.smoothed(x, y, self.dt)
        if "vx" in table:
            vx, vy = (table[name][track] * scales["velocity"] for name in ("vx", "vy"))
            vy = up * vy
            self._check("a velocity", track, vx + vy)
        heading = table["heading"][track] * scales["heading"] * up if "heading" in table else None
        if heading is None or np.isnan(heading).all():
            heading = tracks.heading_of_motion(vx, vy)
        elif (np.abs(heading) > _LARGEST_HEADING).any():
            row = int(track[np.argmax(np.abs(heading) > _LARGEST_HEADING)])
            degrees = f"the heading is {table['heading'][row]:g}, more than a turn"
            raise ValueError(f"{table.row_name(row)}{degrees}")
        if heading is None and not walks:
            if self.direction_at is None:
                raise _NeverMovesError
            direction = self.direction_at(float(np.median(x)), float(np.median(y)))
            if direction is None:
                raise ValueError(
                    "it never moves, and no lane or other vehicle shows its direction: name the "
                    "map with --road"
                )
            heading = np.full(len(x), direction)
        heading = np.zeros(len(x)) if heading is None else heading
        self._check("the heading", track, heading)
        if "speed" in table:
            speed = table["speed"][track] * scales["velocity"]
            self._check("the speed", track, speed)
            vx = speed * np.cos(heading)
            vy = speed * np.sin(heading)
        return wrapped_heading(heading), vx, vy

    def _check(self, what: str, track: np.ndarray, values: np.ndarray) -> None:
        # The largest of a sum of two.
        row = self.table.row_name
        tracks.check_numbers(what, values, lambda at: row(track[at]), 2 * FARTHEST)
