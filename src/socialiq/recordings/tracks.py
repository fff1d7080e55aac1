"""Tracks: where every road user of a recording was, in one table whatever file it came from.

SI units, right-handed: x to the east, y to the north, headings counter-clockwise from east; a
position is the centre of the road user's rectangle. All times are multiples of one step.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float64, Int8, Int32, Int64

from socialiq.demonstrations.columns import json_able
from socialiq.errors import UserError
from socialiq.recordings import checks


class RoadUser(enum.IntEnum):
    """What moves."""

    CAR = 0
    TRUCK = 1
    BUS = 2
    MOTORCYCLE = 3
    BICYCLE = 4
    PEDESTRIAN = 5
    OTHER = 6


@dataclass(frozen=True, eq=False)
class Tracks:
    """One recording's road users: a row for each state, a place in the lists for each track.

    The rows of a track are adjacent and their frames go up by one; tracks stand in the order of
    their numbers, 0, 1, 2, ...

    Attributes:
        track: Number of the track of each state.
        frame: Number of the recording's time step.
        x: Centre, m to the east.
        y: Centre, m to the north.
        heading: rad, counter-clockwise from east, in (-π, π].
        vx: Velocity to the east, m/s.
        vy: Velocity to the north, m/s.
        identity: The road user's number in the file that was read, by track.
        road_user: Value of `RoadUser`, by track.
        length: m along the heading, by track.
        width: m, by track.
        dt: s between frames.
        recording: Its name; data are split by it.
        source: What was read: file, its SHA-256, format, licence line, as JSON would give it back.

    Raises:
        UserError: If a column breaks any of this; the line names it and its first bad place.
    """

    track: Int32[np.ndarray, " state"]
    frame: Int32[np.ndarray, " state"]
    x: Float64[np.ndarray, " state"]
    y: Float64[np.ndarray, " state"]
    heading: Float64[np.ndarray, " state"]
    vx: Float64[np.ndarray, " state"]
    vy: Float64[np.ndarray, " state"]
    identity: Int64[np.ndarray, " track"]
    road_user: Int8[np.ndarray, " track"]
    length: Float64[np.ndarray, " track"]
    width: Float64[np.ndarray, " track"]
    dt: float
    recording: str
    source: dict[str, Any]

    # Run-time type checkers leave the constructor to `__post_init__`, whose lines name the mend.
    __no_type_check__: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check every column, and detach `source` from the caller's dict."""
        checks.check(self.arrays(), self.dt, self.recording, RoadUser)
        object.__setattr__(self, "source", json_able(self.source))

    def arrays(self) -> dict[str, np.ndarray]:
        """All columns by name, in a file's order."""
        return {name: getattr(self, name) for name in (*checks.STATES, *checks.ROAD_USERS)}

    def along_and_across(
        self,
    ) -> tuple[Float64[np.ndarray, " state"], Float64[np.ndarray, " state"]]:
        """Velocity along the heading and to its left, m/s."""
        east, north = np.cos(self.heading), np.sin(self.heading)
        return self.vx * east + self.vy * north, self.vy * east - self.vx * north

    def kept(self, keep: Bool[np.ndarray, " track"]) -> Tracks:
        """Only these tracks, numbered anew.

        Raises:
            UserError: If none is left.
        """
        if not keep.any():
            raise UserError(f"recording {self.recording}: no track is left")
        rows = keep[self.track]
        number = (np.cumsum(keep) - 1).astype(np.int32)
        states = {name: getattr(self, name)[rows] for name in checks.STATES}
        states["track"] = number[states["track"]]
        users = {name: getattr(self, name)[keep] for name in checks.ROAD_USERS}
        return replace(self, **states, **users)

    @property
    def n_states(self) -> int:
        """Number of rows."""
        return len(self.track)

    @property
    def n_tracks(self) -> int:
        """Number of road users."""
        return len(self.identity)

    @property
    def starts(self) -> Int64[np.ndarray, " track_and_one"]:
        """Row of each track's first state, and behind them the number of rows."""
        return np.searchsorted(self.track, np.arange(self.n_tracks + 1)).astype(np.int64)
