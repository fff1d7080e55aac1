"""Moments that two recordings have in common, found by the motion of their vehicles.

Speeds do not depend on a recording's frame, origin or numbers. Seconds of equal, changing speed
propose a lag between the two clocks; the paths in common propose the turn and shift between the two
frames; vehicles that then are at the same place at the same times, standing ones too, are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial import KDTree

from socialiq_recordings.identity.alignment import Placement
from socialiq_recordings.recording import STATES, Tracks

SAME_SPEED = 0.06
"""m/s; largest difference of two speeds in a second that is proposed as the same."""

SAME_PLACE = 0.5
"""m; largest median distance of the same vehicle in two recordings."""

FEWEST_STATES = 5
"""States in common that identify a vehicle, once clocks and frames are aligned."""

_CHANGE = 0.3  # m/s; a second with less change of speed proposes nothing
_STRIDES = 5  # of a second's descriptor
_LAGS = 5  # lags that are tried
_TRIALS = 12  # pairs of vehicles whose paths propose a placement, for each lag
_LEAST_SHARE = 0.5  # of the states in common view that must have a partner
_ALONE = 3.0  # s in common that identify a vehicle without a second one
_LEAST_PATH = 3.0  # m; shorter paths fix no turn
_COMMON_STEP = 0.1  # s, of recordings with different steps


@dataclass(frozen=True, eq=False)
class Common:
    """Moments in common of two recordings.

    Attributes:
        lag: s; time of the second recording at frame 0 of the first.
        seconds: Duration in common.
        vehicles: Rows of track numbers, of the first and of the second recording.
    """

    lag: float
    seconds: float
    vehicles: Int64[np.ndarray, "vehicle 2"]


class Motion:
    """Tracks prepared for comparisons.

    Args:
        tracks: The tracks.

    Attributes:
        tracks: The tracks.
        speed: m/s, by state.
    """

    def __init__(self, tracks: Tracks) -> None:
        self.tracks = tracks
        self.speed = np.hypot(tracks.vx, tracks.vy)

    @cached_property
    def stride(self) -> int:
        """Number of frames between the speeds of a descriptor."""
        return max(1, round(1.0 / _STRIDES / self.tracks.dt))

    @cached_property
    def seconds(self) -> tuple[Int64[np.ndarray, " window"], Float64[np.ndarray, "window speed"]]:
        """First rows of all seconds of a track, and the speeds in them."""
        rows = np.arange(max(self.tracks.n_states - _STRIDES * self.stride, 0))
        rows = rows[self.tracks.track[rows] == self.tracks.track[rows + _STRIDES * self.stride]]
        reach = np.arange(_STRIDES + 1) * self.stride
        speeds = self.speed[rows[:, None] + reach]
        changing = np.ptp(speeds, axis=1) >= _CHANGE
        return rows[changing], speeds[changing]

    @cached_property
    def proposed(self) -> Int64[np.ndarray, " some"]:
        """Windows that are looked for: the most changing one of each track and second."""
        rows, speeds = self.seconds
        length = _STRIDES * self.stride
        group = self.tracks.track[rows].astype(np.int64) * (1 << 32)
        group += self.tracks.frame[rows] // length
        order = np.lexsort([-np.ptp(speeds, axis=1), group])
        return order[np.unique(group[order], return_index=True)[1]]

    @cached_property
    def tree(self) -> KDTree:
        """Tree of all windows' speeds."""
        return KDTree(self.seconds[1])

    @cached_property
    def by_time(self) -> KDTree:
        """Tree of all states' places, with a third axis that separates frames."""
        return KDTree(self.places(0))

    def places(self, lag: int) -> Float64[np.ndarray, "state 3"]:
        """Return x, y and the frame, lag frames later, on an axis that separates frames."""
        far = (self.tracks.frame + float(lag)) * (4 * SAME_PLACE)
        return np.column_stack([self.tracks.x, self.tracks.y, far])

    def resampled(self) -> Motion:
        """Return the tracks with states every 0.1 s, linear in between."""
        return Motion(_every(self.tracks, _COMMON_STEP))


def in_common(motion: Motion, other_motion: Motion) -> Common | None:
    """Return the moments that two recordings have in common; None if none are found."""
    if abs(motion.tracks.dt - other_motion.tracks.dt) > 1e-9:
        motion, other_motion = motion.resampled(), other_motion.resampled()
    pairs, lags = _proposals(motion, other_motion)
    if not len(lags):
        return None
    values, counts = np.unique(lags, return_counts=True)
    best: tuple[float, Common] | None = None
    for lag in values[np.argsort(-counts, kind="stable")][:_LAGS].tolist():
        for pair in _most_frequent(pairs[lags == lag])[:_TRIALS]:
            placement = _placement(motion, other_motion, pair, lag)
            match = None if placement is None else _matched(motion, other_motion, placement, lag)
            if match is not None and (best is None or match[0] > best[0]):
                best = match
        if best is not None and best[0] > 2 * _LEAST_SHARE * 0.9:
            break
    return None if best is None else best[1]


def _proposals(one: Motion, other: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of tracks with a second of equal speeds, and the lag in frames of each."""
    rows, speeds = one.seconds
    chosen = one.proposed
    if not len(chosen) or not len(other.seconds[0]):
        return np.zeros((0, 2), np.int64), np.zeros(0, np.int64)
    near = other.tree.query_ball_point(speeds[chosen], SAME_SPEED, p=np.inf)
    states = np.repeat(rows[chosen], [len(one_near) for one_near in near])
    other_states = other.seconds[0][np.concatenate([*near, []]).astype(np.int64)]
    pairs = np.column_stack([one.tracks.track[states], other.tracks.track[other_states]]).astype(
        np.int64
    )
    lags = other.tracks.frame[other_states].astype(np.int64) - one.tracks.frame[states]
    return pairs, lags


def _most_frequent(pairs: np.ndarray) -> np.ndarray:
    distinct, counts = np.unique(pairs, axis=0, return_counts=True)
    return distinct[np.argsort(-counts, kind="stable")]


def _rows_in_common(one: Tracks, other: Tracks, pair: np.ndarray, lag: int) -> tuple[slice, slice]:
    """Return the rows of two tracks at their common times."""
    span, other_span = one.starts[pair[0] : pair[0] + 2], other.starts[pair[1] : pair[1] + 2]
    first, other_first = int(one.frame[span[0]]), int(other.frame[other_span[0]]) - lag
    begin = max(first, other_first)
    end = min(first + int(span[1] - span[0]), other_first + int(other_span[1] - other_span[0]))
    count, a, b = max(end - begin, 0), int(span[0]), int(other_span[0])
    a, b = a + begin - first, b + begin - other_first
    return slice(a, a + count), slice(b, b + count)


def _placement(one: Motion, other: Motion, pair: np.ndarray, lag: int) -> Placement | None:
    """Return the rigid motion of a vehicle's path in the other recording to that in the one.

    The least-squares solution of Kabsch (1976), in the plane.
    """
    rows_here, rows_there = _rows_in_common(one.tracks, other.tracks, pair, lag)
    if (rows_here.stop - rows_here.start) * one.tracks.dt < 1.0 - 1e-9:
        return None
    speeds = np.abs(one.speed[rows_here] - other.speed[rows_there])
    a, b = (
        np.column_stack([which.tracks.x[rows], which.tracks.y[rows]])
        for which, rows in ((one, rows_here), (other, rows_there))
    )
    if np.median(speeds) > SAME_SPEED or np.hypot(*np.ptp(a, axis=0)) < _LEAST_PATH:
        return None
    centre, other_centre = a.mean(axis=0), b.mean(axis=0)
    a, b = a - centre, b - other_centre
    turn = np.arctan2((b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]).sum(), (a * b).sum())
    about = Placement(float(turn), np.zeros(2))
    shift = centre - about.of(np.array([[*other_centre, 0.0]]))[0, :2]
    placement = Placement(float(turn), shift)
    off = about.of(np.column_stack([b, np.zeros(len(b))]))[:, :2] - a
    return placement if np.median(np.hypot(*off.T)) <= SAME_PLACE else None


def _matched(
    one: Motion, other: Motion, placement: Placement, lag: int
) -> tuple[float, Common] | None:
    """Return the share of the common view with a partner, and the vehicles in common."""
    places = other.places(-lag)
    moved = placement.of(places[:, [0, 1, 1]])[:, :2]
    distance, nearest = one.by_time.query(
        np.column_stack([moved, places[:, 2]]), distance_upper_bound=SAME_PLACE
    )
    met = np.isfinite(distance)
    if met.sum() < FEWEST_STATES:
        return None
    share = _share(one, other, moved, met, lag)
    if share < _LEAST_SHARE:
        return None
    pairs = np.column_stack([one.tracks.track[np.asarray(nearest)[met]], other.tracks.track[met]])
    distinct, counts = np.unique(pairs.astype(np.int64), axis=0, return_counts=True)
    distinct = distinct[np.argsort(-counts, kind="stable")]
    counts = np.sort(counts)[::-1]
    rows = [
        row
        for row in np.flatnonzero(counts >= FEWEST_STATES).tolist()
        if _first(distinct, row, 0) and _first(distinct, row, 1)
    ]
    if not rows or (len(rows) < 2 and counts[0] * one.tracks.dt < _ALONE):
        return None
    frames = np.unique(other.tracks.frame[met])
    common = Common(lag * one.tracks.dt, len(frames) * one.tracks.dt, distinct[rows])
    return share * len(frames), common


def _first(pairs: np.ndarray, row: int, side: int) -> bool:
    return not (pairs[:row, side] == pairs[row, side]).any()


def _share(one: Motion, other: Motion, moved: np.ndarray, met: np.ndarray, lag: int) -> float:
    """Return the share of states with a partner, of those that both recordings could have seen."""
    frames = one.tracks.frame + lag
    inside = _within(moved, np.column_stack([one.tracks.x, one.tracks.y]))
    inside &= np.isin(other.tracks.frame, frames)
    covered = _within(np.column_stack([one.tracks.x, one.tracks.y]), moved)
    covered &= np.isin(frames, other.tracks.frame)
    fewer = min(int(inside.sum()), int(covered.sum()))
    return float(met.sum()) / fewer if fewer else 0.0


def _within(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Whether points lie in the axis-parallel box around others."""
    low, high = box.min(axis=0) - SAME_PLACE, box.max(axis=0) + SAME_PLACE
    return ((points >= low) & (points <= high)).all(axis=1)


def _every(tracks: Tracks, step: float) -> Tracks:
    """Return the tracks with states at multiples of a step, linear in between."""
    columns: dict[str, list[np.ndarray]] = {name: [] for name in STATES}
    for track, (first, end) in enumerate(zip(tracks.starts[:-1], tracks.starts[1:], strict=True)):
        time = tracks.frame[first:end] * tracks.dt
        frame = np.arange(np.ceil(time[0] / step - 1e-9), np.floor(time[-1] / step + 1e-9) + 1)
        frame = frame if len(frame) else np.array([np.round(time[0] / step)])
        columns["track"].append(np.full(len(frame), track, np.int32))
        columns["frame"].append(frame.astype(np.int32))
        for name in ("x", "y", "vx", "vy"):
            columns[name].append(np.interp(frame * step, time, getattr(tracks, name)[first:end]))
        columns["heading"].append(np.zeros(len(frame)))
    states = {name: np.concatenate(pieces) for name, pieces in columns.items()}
    users = {name: getattr(tracks, name) for name in ("identity", "road_user", "length", "width")}
    return Tracks(**states, **users, dt=step, recording=tracks.recording, source=tracks.source)
