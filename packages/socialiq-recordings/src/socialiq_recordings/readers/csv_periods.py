"""Frames and recordings of the rows of a CSV file: by a column, and by periods of observation."""

from __future__ import annotations

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq_recordings.readers.column_map import ColumnMap
from socialiq_recordings.readers.csv_table import Table

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
    found, group = np.unique(pairs, axis=0, return_inverse=True)
    if len(found) > _MOST_RECORDINGS:
        raise UserError(
            f"{table.path}: {len(found):,} periods: frames and times have different rates; correct "
            "the rate or the unit of time in the column map"
        )
    several = {word for word in found[:, 0].tolist() if (found[:, 0] == word).sum() > 1}
    numbers = [(found[:at, 0] == word).sum() + 1 for at, word in enumerate(found[:, 0])]
    return group.ravel(), {
        at: names[word] + (f"-period-{numbers[at]}" if word in several else "")
        for at, word in enumerate(found[:, 0].tolist())
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
