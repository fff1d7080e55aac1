"""Tracks that a reader gathers, and velocities and headings derived from positions and lanes.

Every reader leaves out a track that can't be read, with its reason in the same words. It refuses a
file only if no track is left, or if more than half of the file's rows have one fault.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq_recordings.recording import FARTHEST, Imported, Recording, Refused, RoadUser, Tracks
from socialiq_recordings.road.network import RoadNetwork, every_step, tree_of

MOST_STATES = 5_000_000
"""States of a file that are read by default: 1.5 GB of memory at the peak, 300 bytes for each
(`socialiq bench recordings`). An XML file of 1 GB has two or three million."""

STEPS = (1e-4, 1e3)  # s; shortest and longest time between frames that is read
Column = Float64[np.ndarray, " state"]
User = tuple[int, float, float]  # class, length and width of a road user, m


def check_frames(
    frames: Int[np.ndarray, " state"] | Sequence[int], row: Callable[[int], str] = lambda _: ""
) -> None:
    """Check that a track's frames increase by one, within 31 bits.

    Args:
        frames: Frame of each state.
        row: Function that returns the name of a state's row, by its index, for the message.

    Raises:
        ValueError: If they do not; the line begins with the name of the first such row.
    """
    steps = np.diff(np.asarray(frames, np.int64))
    if not (steps == 1).all():
        index = int(np.argmax(steps != 1))
        before = frames[index]
        after = frames[index + 1]
        fault = f"frame {after} follows frame {before}: a gap of {after - before - 1}"
        if after == before:
            fault = f"frame {after} is there twice"
        elif after < before:
            fault = f"time goes back: frame {after} follows frame {before}"
        raise ValueError(f"{row(index + 1)}{fault}")
    if not -1 < frames[0] <= frames[-1] < 2**31:
        raise ValueError(f"{row(0)}frame {frames[0]} is negative or out of range")


def repeated(
    frames: Int[np.ndarray, " state"], states: Float64[np.ndarray, "value state"]
) -> Bool[np.ndarray, " state"]:
    """Whether each state of a track repeats the one before it exactly; NaN equals NaN.

    Args:
        frames: Frame of each state.
        states: Values of the states, a column for each.

    Returns:
        A value for each state; the first repeats none.
    """
    after = states[:, 1:]
    before = states[:, :-1]
    same = (after == before) | (np.isnan(after) & np.isnan(before))
    return np.append(False, (np.diff(frames) == 0) & same.all(axis=0))


def check_numbers(
    what: str, values: Column, row: Callable[[int], str], farthest: float = FARTHEST
) -> None:
    """Check that all numbers of a track are finite and not too large.

    Args:
        what: Name of the quantity, for the message.
        values: A number for each state.
        row: Function that returns the name of a state's row, by its index, for the message.
        farthest: Largest absolute value, in the unit of the numbers.

    Raises:
        ValueError: If a number is missing, not finite or too large; the line begins with the row's
            name.
    """
    bad = ~(np.abs(values) <= farthest)
    if bad.any():
        raise ValueError(f"{row(int(np.argmax(bad)))}{what} is missing, not finite or too large")


class Gathered:
    """Tracks of a file, and those that can't be used, which are listed with their reasons."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.n_states = 0
        self.skipped: dict[str, int] = {}  # elements that are not tracks, by kind
        self._refused: list[Refused] = []
        self.faults: list[Refused] = []  # rows and classes that could not be read
        self._unknown: list[Refused] = []
        self._users: list[tuple[int, User]] = []
        self._frames: list[np.ndarray] = []
        self._states: list[np.ndarray] = []

    def add(
        self,
        identity: int,
        user: User,
        frame: Int[np.ndarray, " state"],
        states: Float64[np.ndarray, "5 state"],
    ) -> None:
        """Add a checked track.

        Args:
            identity: Number of the road user in the file.
            user: Its class, length and width, m.
            frame: Frame of each state.
            states: x and y, m, heading, rad, vx and vy, m/s, a column for each state.
        """
        self._users.append((identity, user))
        self._frames.append(frame.astype(np.int32))
        self._states.append(states)

    def refuse(self, identity: object, reason: object, kind: int | None = None) -> None:
        """Leave a track out.

        Args:
            identity: Name of the road user in the file.
            reason: Reason for which it is left out.
            kind: Its class, of `RoadUser`; None if it is not known.
        """
        name = one_line(str(identity), 60)
        reason = one_line(str(reason))
        kind_name = "" if kind is None else RoadUser(kind).name.lower()
        self._refused.append(Refused(name, reason, kind_name))

    def note(self, kind: str, count: int = 1) -> None:
        """Count elements that are left out.

        Args:
            kind: Kind of the elements.
            count: Number of them.
        """
        if count:
            self.skipped[kind] = self.skipped.get(kind, 0) + count

    def unknown(self, identity: object, reason: str) -> None:
        """Name a road user of an unknown class, which is read as `OTHER`.

        Args:
            identity: Name of the road user in the file.
            reason: Line about the class.
        """
        self.note("unknown class")
        self._unknown.append(Refused(one_line(str(identity), 60), reason))

    def imported(
        self, recording: str, dt: float, source: dict[str, Any], road: RoadNetwork
    ) -> Imported:
        """Return the recording of the tracks that were added.

        Args:
            recording: Name of the recording.
            dt: Time between frames, s.
            source: Provenance of the recording.
            road: Its road.

        Returns:
            The recording, with all that was left out and the reasons.

        Raises:
            UserError: If no track was added, or more than half of them have an unknown class.
        """
        if 2 * len(self._unknown) > len(self._users) > 0:
            raise UserError(f"{self.path}: {self._unknown[0].reason}, like most of its road users")
        if not self._users:
            first = "".join(f"; the first, {r.identity}: {r.reason}" for r in self._refused[:1])
            raise UserError(f"{self.path}: no track can be used{first}")
        lengths = [len(frame) for frame in self._frames]
        columns = [np.concatenate(column) for column in zip(*self._states, strict=True)]
        users = [user for _, user in self._users]
        tracks = Tracks(
            np.repeat(np.arange(len(users), dtype=np.int32), lengths),
            np.concatenate(self._frames),
            *columns,
            identity=np.array([identity for identity, _ in self._users], np.int64),
            road_user=np.array([int(kind) for kind, _, _ in users], np.int8),
            length=np.array([length for _, length, _ in users], np.float64),
            width=np.array([width for _, _, width in users], np.float64),
            dt=dt,
            recording=recording,
            source=source,
        )
        imported = Recording(tracks, road), tuple(self._refused), dict(self.skipped)
        return Imported(*imported, self.n_states, (*self.faults, *self._unknown, *road.faults))


STILL = 0.5
"""m/s; slower than this, the direction of a smoothed displacement is noise and the last direction
at speed is kept."""

WINDOW = 1.1  # s over which positions are smoothed by a quadratic before they are differenced
_MOVING = 1.0  # m/s
_LANE = 2.5  # m; a standing vehicle is in a lane whose middle is this close
_PASSED = 1.0  # m; or stands where another passed


def differences(x: Column, y: Column, dt: float) -> tuple[Column, Column]:
    """Return a track's velocity by central differences, one-sided at its ends; 0 for one state.

    Args:
        x: Positions to the east, m.
        y: Positions to the north, m.
        dt: Time between the states, s.

    Returns:
        Velocities along x and y, m/s.
    """
    if len(x) < 2:
        return np.zeros(len(x)), np.zeros(len(x))
    return np.gradient(x, dt), np.gradient(y, dt)


def smoothed(x: Column, y: Column, dt: float) -> tuple[Column, Column]:
    """Return a track's velocity, m/s, by a local quadratic (Savitzky and Golay 1964).

    The number of frames is odd and fits `WINDOW` and the track; a track of fewer than three states
    is differenced.

    Args:
        x: Positions to the east, m.
        y: Positions to the north, m.
        dt: Time between the states, s.

    Returns:
        Velocities along x and y, m/s.
    """
    window = min(2 * round(WINDOW / dt / 2) + 1, len(x) - (len(x) + 1) % 2)
    if window < 3:
        return differences(x, y, dt)
    from scipy.signal import savgol_filter  # slow to import

    vx, vy = (
        np.asarray(savgol_filter(positions, window, 2, deriv=1, delta=dt, mode="interp"))
        for positions in (x, y)
    )
    return vx, vy


def heading_of_motion(vx: Column, vy: Column) -> Column | None:
    """Return the direction of travel, rad in (-π, π]; None if the track never moves.

    Below `STILL`, it is that of the last faster state; before a track first moves, its first.

    Args:
        vx: Velocities along x, m/s.
        vy: Velocities along y, m/s.
    """
    moving = np.flatnonzero(np.hypot(vx, vy) >= STILL)
    if not len(moving):
        return None
    last = np.maximum(np.searchsorted(moving, np.arange(len(vx)), side="right") - 1, 0)
    return np.arctan2(vy, vx)[moving[last]]


def directions(
    road: RoadNetwork, states: Sequence[Float64[np.ndarray, "5 _"]]
) -> Callable[[float, float], float | None]:
    """Return a function of a place that returns the direction of the lane at this place.

    Without lanelets it is the direction of the vehicles that moved at the place.

    Args:
        road: Road with lanelets, or an empty one.
        states: Of each vehicle x and y, m, heading, rad, vx and vy, m/s, a column for each state.

    Returns:
        A function of x and y, m. It returns rad, or None if no lane or moving vehicle is near.
    """
    lines = [every_step(lanelet.centre) for lanelet in road.lanelets.values()]
    reach = _LANE if lines else _PASSED
    lines = lines or [rows[:3, np.hypot(rows[3], rows[4]) >= _MOVING].T for rows in states]
    points = np.concatenate([np.zeros((0, 3)), *lines])
    tree = tree_of(points[:, :2])

    def at(x: float, y: float) -> float | None:
        if not len(points) or not np.isfinite([x, y]).all():
            return None
        distance, nearest = tree.query([x, y])
        return float(points[nearest, 2]) if distance <= reach else None

    return at
