"""What makes columns one table of tracks: every check, one line each.

A line names the column, its first bad row or track, and what mends it. Later checks rely on earlier
ones. Whether the numbers can be true at all is another question (`recordings.physics`).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from socialiq.errors import UserError

STATES: dict[str, type[np.generic]] = {
    "track": np.int32,
    "frame": np.int32,
    "x": np.float64,
    "y": np.float64,
    "heading": np.float64,
    "vx": np.float64,
    "vy": np.float64,
}
"""Columns with a row for each state, and their types; also their order in a file."""

ROAD_USERS: dict[str, type[np.generic]] = {
    "identity": np.int64,
    "road_user": np.int8,
    "length": np.float64,
    "width": np.float64,
}
"""Columns with a place for each track."""


def check(columns: Mapping[str, Any], dt: Any, recording: Any, kinds: type[enum.IntEnum]) -> None:
    """Refuse columns that do not make one table of tracks.

    Args:
        columns: One array for each name of `STATES` and `ROAD_USERS`.
        dt: s between frames.
        recording: The recording's name.
        kinds: What `road_user` may hold.

    Raises:
        UserError: At the first violation.
    """
    if not isinstance(dt, float) or not 0 < dt < math.inf:
        raise UserError(f"dt is {dt!r}: pass the seconds between frames, a float above 0")
    if not isinstance(recording, str) or not recording.strip():
        raise UserError("recording must be a non-empty string: data are split by it")
    _check_layout(columns, STATES, "states")
    _check_layout(columns, ROAD_USERS, "tracks")
    for name, dtype in (STATES | ROAD_USERS).items():
        if issubclass(dtype, np.floating):
            _refuse(name, ~np.isfinite(columns[name]), "not finite: mend it or leave the track out")
    _check_order(columns)
    heading = columns["heading"]
    _refuse(
        "heading",
        (heading <= -np.pi) | (heading > np.pi),
        "outside (-π, π]: give radians, wrapped; are these degrees?",
    )
    for name in ("length", "width"):
        _refuse(name, columns[name] <= 0, "not above 0: give metres", "track")
    _refuse(
        "road_user",
        ~np.isin(columns["road_user"], [int(kind) for kind in kinds]),
        f"unknown: use {', '.join(f'{kind.value} {kind.name}' for kind in kinds)}",
        "track",
    )


def _check_layout(
    columns: Mapping[str, Any], layout: Mapping[str, type[np.generic]], what: str
) -> None:
    first = next(iter(layout))
    for name, dtype in layout.items():
        column = columns[name]
        if not isinstance(column, np.ndarray) or column.dtype != dtype or column.ndim != 1:
            found = f"{column.dtype}" if isinstance(column, np.ndarray) else type(column).__name__
            raise UserError(
                f"column {name} is {found}: pass a one-dimensional NumPy array of {dtype.__name__}"
            )
        if len(column) != len(columns[first]):
            raise UserError(
                f"column {name} has {len(column)} {what} where {first} has {len(columns[first])}"
            )
    if not len(columns[first]):
        raise UserError(f"no {what}: a recording has at least one track of one state")


def _refuse(name: str, bad: np.ndarray, problem: str, what: str = "row") -> None:
    """Refuse the column if any place is bad, naming the first."""
    if bad.any():
        raise UserError(f"column {name}, {what} {int(np.argmax(bad))}: {problem}")


def _check_order(columns: Mapping[str, Any]) -> None:
    track, frame = columns["track"].astype(np.int64), columns["frame"].astype(np.int64)
    steps = np.diff(track)
    bad = np.concatenate([[track[0] != 0], (steps != 0) & (steps != 1)])
    _refuse("track", bad, "number tracks 0, 1, 2, ... in order, with their rows adjacent")
    tracks = len(columns["identity"])
    if track[-1] != tracks - 1:
        raise UserError(f"column track numbers {track[-1] + 1} tracks where identity has {tracks}")
    _refuse("frame", frame < 0, "negative: count frames from 0 or above")
    jumps = np.concatenate([[False], (steps == 0) & (np.diff(frame) != 1)])
    _refuse("frame", jumps, "does not follow the frame before: frames of a track go up by one")
