"""Reader of recordings in CSV files of any layout, by a column map, without road."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import sha256_of_file
from socialiq_recordings.readers.column_map import ColumnMap
from socialiq_recordings.readers.commonroad import MOST_STATES
from socialiq_recordings.readers.csv_table import (
    Table,
    frames_of,
    origin_of,
    rate_of,
    recordings_of,
    users_of,
)
from socialiq_recordings.readers.motion import Directions, heading_of_motion, smoothed, wrapped
from socialiq_recordings.recording import (
    FARTHEST,
    Imported,
    Recording,
    Refused,
    RoadUser,
    Tracks,
    order_fault,
)
from socialiq_recordings.road.network import RoadNetwork

_TURN = 2 * np.pi


def read_csv(
    path: Path,
    columns: ColumnMap,
    most_states: int = MOST_STATES,
    road: RoadNetwork | None = None,
) -> list[Imported]:
    """Read the recordings of a CSV file. Of physics only headings beyond a full turn are checked.

    Args:
        path: The file with the states.
        columns: Column map of the file.
        most_states: More rows than these are refused before they fill the memory.
        road: Lanelets, if a map is at hand.

    Returns:
        The recordings of the file.

    Raises:
        UserError: If a file is missing, empty, lacks a column, has a cell that can't be read, is
            too large, or no track can be used; the line has the row or the id.
    """
    table = Table(path, columns.separator, most_states)
    table.read(columns.columns, frozenset({"recording", "class"}), frozenset({"id", "frame"}))
    dt = 1 / rate_of(path, columns)
    frame = frames_of(table, columns, dt)
    users = users_of(path, columns)
    source: dict[str, Any] = {
        "format": columns.format,
        "file": path.name,
        "sha256": sha256_of_file(path),
        "licence": columns.licence,
    }
    origin = origin_of(path, columns)
    if origin is not None:
        source |= {"utm_origin": list(origin)}
    group, names = recordings_of(table, columns, frame, dt)
    recordings = []
    for number, name in names.items():
        rows = np.flatnonzero(group == number)
        draft = _Draft(table, columns, users, frame, dt, road or RoadNetwork())
        recordings.append(draft.imported(rows, name, source))
    return recordings


class _NeverMovesError(Exception):
    """A track without a heading never moves."""


class _Draft:
    """Builder of a recording from some rows of a table."""

    def __init__(
        self,
        table: Table,
        columns: ColumnMap,
        users: Table | None,
        frame: np.ndarray,
        dt: float,
        road: RoadNetwork,
    ) -> None:
        self._table, self._columns, self._users, self._dt = table, columns, users, dt
        self._frame, self._road = frame, road
        self._directions: Directions | None = None
        self._refused: list[Refused] = []

    def imported(self, rows: np.ndarray, name: str, source: dict[str, Any]) -> Imported:
        n_states = len(rows)
        rows, starts = self._sorted(rows)
        self._check_heading_unit(rows)
        self._check_rate(rows, starts)
        tracks_by_row, standing = {}, []
        for first, end in itertools.pairwise(starts):
            try:
                tracks_by_row[first] = self._read(rows[first:end])
            except _NeverMovesError:
                standing.append((first, end))
            except ValueError as error:
                self._refuse(rows[first:end], str(error))
        if standing:
            self._directions = Directions(
                self._road, [track[2] for track in tracks_by_row.values()]
            )
        for first, end in standing:
            try:
                tracks_by_row[first] = self._read(rows[first:end])
            except ValueError as error:
                self._refuse(rows[first:end], str(error))
        used, users, states = (
            zip(*(tracks_by_row[first] for first in sorted(tracks_by_row)), strict=True)
            if tracks_by_row
            else ((), (), ())
        )
        if not used:
            first = f"{self._refused[0].identity}: {self._refused[0].reason}"
            raise UserError(f"{self._table.path}: no track can be used; the first, {first}")
        columns = np.concatenate(states, axis=1)
        all_rows = np.concatenate(used)
        tracks = Tracks(
            track=np.repeat(
                np.arange(len(used), dtype=np.int32), [len(rows_of) for rows_of in used]
            ),
            frame=self._frame[all_rows].astype(np.int32),
            x=columns[0],
            y=columns[1],
            heading=columns[2],
            vx=columns[3],
            vy=columns[4],
            identity=np.array([self._table["id"][rows_of[0]] for rows_of in used], np.int64),
            road_user=np.array([user[0] for user in users], np.int8),
            length=np.array([user[1] for user in users]),
            width=np.array([user[2] for user in users]),
            dt=self._dt,
            recording=name,
            source=dict(source),
        )
        recording = Recording(tracks, self._road)
        return Imported(recording, tuple(self._refused), {}, n_states)

    def _read(self, track: np.ndarray) -> tuple[np.ndarray, tuple[int, float, float], np.ndarray]:
        user = self._user(track)
        return track, user, self._states(track, user)

    def _refuse(self, track: np.ndarray, reason: str) -> None:
        self._refused.append(Refused(str(self._table["id"][track[0]]), one_line(reason)))

    def _sorted(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows by track, the first row of each track, and the number of rows."""
        identity = self._table["id"][rows]
        if self._columns.any_order:
            order = np.lexsort((self._frame[rows], identity))
        else:
            order = np.argsort(identity, kind="stable")
        rows = rows[order]
        new = np.diff(identity[order]) != 0
        if self._columns.repeated_ids:
            new |= np.diff(self._frame[rows]) > 1
        return rows, np.concatenate([[0], np.flatnonzero(new) + 1, [len(rows)]])

    def _check_heading_unit(self, rows: np.ndarray) -> None:
        if "heading" in self._table:
            far = (
                np.abs(self._table["heading"][rows] * self._columns.scales["heading"]) > _TURN * 1.1
            )
            if far.any():
                row = rows[np.argmax(far)]
                raise UserError(
                    f"{self._table.path}, {self._table.row_name(int(row))}: the heading is "
                    f"{self._table['heading'][row]:g}, more than a turn: these are degrees; say so "
                    "in the column map's [units]"
                )

    def _check_rate(self, rows: np.ndarray, starts: np.ndarray) -> None:
        """Raise an error if the file's frames and times have different rates."""
        if "time" not in self._table or "frame" not in self._table:
            return
        inside = np.ones(len(rows) - 1, bool)
        inside[starts[1:-1] - 1] = False
        time = np.diff(self._table["time"][rows]) * self._columns.scales["time"]
        off = inside & ~(np.abs(time - np.diff(self._frame[rows]) * self._dt) < self._dt / 2)
        if off.any():
            index = int(np.argmax(off))
            row = self._table.row_name(int(rows[index + 1]))
            raise UserError(
                f"{self._table.path}, {row}: {time[index]:g} s after the frame before, with frames "
                f"{self._dt:g} s apart: correct the rate or the unit of time in the column map"
            )

    def _user(self, track: np.ndarray) -> tuple[int, float, float]:
        """Return class, length and width of a track."""
        table, places = self._table, track
        if self._users is not None:
            rows = np.flatnonzero(self._users["id"] == table["id"][track[0]])
            if not len(rows):
                raise ValueError(f"no row in {self._users.path.name}")
        else:
            rows = track
        beside = self._users
        of_class = (beside, rows) if beside is not None and "class" in beside else (table, places)
        numbers = of_class[0]["class"][of_class[1]]
        word = of_class[0].word("class", int(numbers[0]))
        if (numbers != numbers[0]).any():
            raise ValueError(f"its class changes from '{word}': give each road user its own id")
        kind = self._columns.classes.get(word.strip())
        if kind is None:
            raise UserError(
                f"{of_class[0].path}, {of_class[0].row_name(int(of_class[1][0]))}: class "
                f"'{one_line(word, 40)}' is not in the column map's [classes]"
            )
        length, width = (self._size(side, rows, places) for side in ("length", "width"))
        if not (length > 0 and width > 0):
            if word.strip() not in self._columns.default_sizes:
                raise ValueError(f"it has no size, nor has {kind.name.lower()} a default")
            length, width = self._columns.default_sizes[word.strip()]
        return int(kind), float(length), float(width)

    def _size(self, side: str, found: np.ndarray, places: np.ndarray) -> float:
        beside = self._users
        here = beside is not None and side in beside
        values = beside[side][found] if here and beside is not None else self._table[side][places]
        good = values[np.isfinite(values)] * self._columns.scales["size"]
        return float(np.median(good)) if len(good) else 0.0

    def _states(self, track: np.ndarray, user: tuple[int, float, float]) -> np.ndarray:
        """Return five rows: x, y, heading, vx, vy."""
        fault = order_fault(self._frame[track])
        if fault:
            jump = int(np.argmax(np.diff(self._frame[track]) != 1)) + 1
            raise ValueError(f"{self._table.row_name(int(track[jump]))}: {fault}")
        kind, length, width = user
        up = -1.0 if self._columns.y_down else 1.0
        x, y = (self._table[axis][track] * self._columns.scales["position"] for axis in "xy")
        self._check_finite("x or y", track, x + y)
        if self._columns.point == "corner":
            # The upper left corner of an axis-parallel box, with y as in the file.
            x, y = x + length / 2, y + width / 2 * -up
        y = up * y
        heading, vx, vy = self._motion(track, x, y, kind == RoadUser.PEDESTRIAN)
        if self._columns.point == "front":
            x, y = x - length / 2 * np.cos(heading), y - length / 2 * np.sin(heading)
        return np.stack([x, y, heading, vx, vy])

    def _motion(
        self, track: np.ndarray, x: np.ndarray, y: np.ndarray, walks: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        table, scales = self._table, self._columns.scales
        up = -1.0 if self._columns.y_down else 1.0
        vx, vy = smoothed(x, y, self._dt)
        if "vx" in table:
            vx, vy = (
                table["vx"][track] * scales["velocity"],
                table["vy"][track] * scales["velocity"],
            )
            vy = up * vy
            self._check_finite("a velocity", track, vx + vy)
        heading = table["heading"][track] * scales["heading"] * up if "heading" in table else None
        if heading is None or np.isnan(heading).all():
            heading = heading_of_motion(vx, vy)
            if heading is None and not walks:
                heading = self._standing(x, y)
            heading = np.zeros(len(x)) if heading is None else heading
        self._check_finite("the heading", track, heading)
        if "speed" in table:
            speed = table["speed"][track] * scales["velocity"]
            self._check_finite("the speed", track, speed)
            vx, vy = speed * np.cos(heading), speed * np.sin(heading)
        return wrapped(heading), vx, vy

    def _standing(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the direction of the lane in which a vehicle stands."""
        if self._directions is None:
            raise _NeverMovesError
        direction = self._directions.at(float(np.median(x)), float(np.median(y)))
        if direction is None:
            raise ValueError(
                "it never moves, and no lane or other vehicle shows its direction: name the map "
                "with --road"
            )
        return np.full(len(x), direction)

    def _check_finite(self, what: str, track: np.ndarray, values: np.ndarray) -> None:
        bad = ~(np.abs(values) <= 2 * FARTHEST)  # of a sum of two
        if bad.any():
            row = self._table.row_name(int(track[np.argmax(bad)]))
            raise ValueError(f"{row}: {what} is missing, not finite or too large")
