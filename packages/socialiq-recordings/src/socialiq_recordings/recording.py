"""Recordings: tracks of all road users in one table for all file formats, and the road.

SI units, right-handed: x to the east, y to the north, headings counter-clockwise from east; a
position is the centre of the road user's rectangle. All times are multiples of one step.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float64, Int8, Int32, Int64

from socialiq.demonstrations.columns import check_layout, json_able
from socialiq.errors import UserError
from socialiq.worlds import road_users
from socialiq_recordings.road.network import Refused, RoadNetwork


class RoadUser(enum.IntEnum):
    """Class of a road user."""

    CAR = 0
    TRUCK = 1
    BUS = 2
    MOTORCYCLE = 3
    BICYCLE = 4
    PEDESTRIAN = 5
    OTHER = 6


PEOPLE = tuple(RoadUser[user.recorded.upper()] for user in road_users.ROAD_USERS if user.recorded)
"""Classes that are replayed among simulated vehicles, and whose sizes are typical, no boxes."""

GROUPS = dict.fromkeys(RoadUser, "vehicle") | {
    kind: kind.name.lower() for kind in (*PEOPLE, RoadUser.OTHER)
}
"""Groups of classes of which effects are counted, by class."""

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
"""Columns with an entry for each track."""

FARTHEST = 1e8  # m, m/s; no coordinate of the Earth is larger, and centimetres would be lost


@dataclass(frozen=True, eq=False)
class Tracks:
    """Road users of a recording: a row for each state, a list entry for each track.

    The rows of a track are adjacent and their frames increase by one; tracks are in the order of
    their numbers, 0, 1, 2, ...

    Raises:
        UserError: If a column is invalid; the line names it and its first bad row or track.
    """

    track: Int32[np.ndarray, " state"]  # number of the track of each state
    frame: Int32[np.ndarray, " state"]  # number of the recording's time step
    x: Float64[np.ndarray, " state"]  # centre, m to the east
    y: Float64[np.ndarray, " state"]  # centre, m to the north
    heading: Float64[np.ndarray, " state"]  # rad, counter-clockwise from east, in (-π, π]
    vx: Float64[np.ndarray, " state"]  # velocity to the east, m/s
    vy: Float64[np.ndarray, " state"]  # velocity to the north, m/s
    identity: Int64[np.ndarray, " track"]  # the road user's number in the file that was read
    road_user: Int8[np.ndarray, " track"]  # value of `RoadUser`, by track
    length: Float64[np.ndarray, " track"]  # m along the heading, by track
    width: Float64[np.ndarray, " track"]  # m, by track
    dt: float  # s between frames
    recording: str  # name of the recording, by which data are split
    source: dict[str, Any]  # provenance as JSON: file, its SHA-256, format, licence line

    # Run-time type checkers leave the constructor to `__post_init__`, whose lines say what to do.
    __no_type_check__: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check every column, and detach `source` from the caller's dict."""
        if not isinstance(self.dt, float) or not 0 < self.dt < math.inf:
            raise UserError(f"dt is {self.dt!r}: pass the seconds between frames, a float above 0")
        if not isinstance(self.recording, str) or not self.recording.strip():
            raise UserError("recording must be a non-empty string: data are split by it")
        columns = self.arrays()
        for layout, what in ((STATES, "state"), (ROAD_USERS, "track")):
            check_layout(columns, {name: (dtype, 1) for name, dtype in layout.items()}, what)
        for name, dtype in (STATES | ROAD_USERS).items():
            if issubclass(dtype, np.floating):
                _refuse(
                    name, ~np.isfinite(columns[name]), "not finite: mend it or leave the track out"
                )
        track = self.track.astype(np.int64)
        frame = self.frame.astype(np.int64)
        steps = np.diff(track)
        bad = np.concatenate([[track[0] != 0], (steps != 0) & (steps != 1)])
        _refuse("track", bad, "number tracks 0, 1, 2, ... in order, with their rows adjacent")
        count = len(self.identity)
        if track[-1] != count - 1:
            raise UserError(
                f"column track numbers {track[-1] + 1} tracks where identity has {count}"
            )
        _refuse("frame", frame < 0, "negative: count frames from 0 or above")
        jumps = np.concatenate([[False], (steps == 0) & (np.diff(frame) != 1)])
        _refuse("frame", jumps, "does not follow the frame before: frames of a track go up by one")
        outside = (self.heading <= -np.pi) | (self.heading > np.pi)
        _refuse("heading", outside, "outside (-π, π]: give radians, wrapped; are these degrees?")
        for name in ("length", "width"):
            _refuse(name, columns[name] <= 0, "not above 0: give metres", "track")
        kinds = ", ".join(f"{kind.value} {kind.name}" for kind in RoadUser)
        unknown = ~np.isin(self.road_user, [int(kind) for kind in RoadUser])
        _refuse("road_user", unknown, f"unknown: use {kinds}", "track")
        object.__setattr__(self, "source", json_able(self.source))

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all columns by name, in a file's order."""
        return {name: getattr(self, name) for name in (*STATES, *ROAD_USERS)}

    def along_and_across(
        self,
    ) -> tuple[Float64[np.ndarray, " state"], Float64[np.ndarray, " state"]]:
        """Return the velocity along the heading and to its left, m/s."""
        east = np.cos(self.heading)
        north = np.sin(self.heading)
        return self.vx * east + self.vy * north, self.vy * east - self.vx * north

    def select(self, keep: Bool[np.ndarray, " track"]) -> Tracks:
        """Return only these tracks, renumbered; raise a `UserError` if none is left."""
        if not keep.any():
            raise UserError(f"recording {self.recording}: no track is left")
        rows = keep[self.track]
        number = (np.cumsum(keep) - 1).astype(np.int32)
        states = {name: getattr(self, name)[rows] for name in STATES}
        states["track"] = number[states["track"]]
        users = {name: getattr(self, name)[keep] for name in ROAD_USERS}
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
        """Row of each track's first state, followed by the number of rows."""
        return np.searchsorted(self.track, np.arange(self.n_tracks + 1)).astype(np.int64)


def _refuse(name: str, bad: np.ndarray, problem: str, what: str = "row") -> None:
    """Raise an error for the column if any entry is bad, naming the first."""
    if bad.any():
        raise UserError(f"column {name}, {what} {int(np.argmax(bad))}: {problem}")


@dataclass(frozen=True, eq=False)
class Recording:
    """Tracks of one source, and the road, without lanelets if the source has no map."""

    tracks: Tracks
    road: RoadNetwork


@dataclass(frozen=True, eq=False)
class Imported:
    """Recording read from a file."""

    recording: Recording  # the tracks that passed every check, and the road
    refused: tuple[Refused, ...]  # the other tracks
    skipped: dict[str, int] = field(default_factory=dict)  # elements that are no tracks, by kind
    n_states: int = 0  # number of states read, including those of refused tracks
    faults: tuple[Refused, ...] = ()  # rows, classes and elements of the road without a meaning
