"""Alignment of two recordings, whatever frame, clock and numbers each is written in.

Lanes are aligned rigidly: turns are proposed by the circular correlation of the histograms of lane
directions, shifts by a vote of all pairs of points with the same direction; both are refined by
iterated closest points with the distance to the line (Chen and Medioni 1992).

Moments in common are found by the motion of vehicles: seconds of equal, changing speed propose a
lag between the two clocks; the paths in common propose the turn and shift between the two frames;
vehicles that then are at the same place at the same times, standing ones too, are the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.physics import wrapped
from socialiq_recordings.recording import STATES, Recording, Tracks
from socialiq_recordings.road.network import STEP, every_step, tree_of
from socialiq_recordings.road.routes import VEHICLES

BESIDE = 0.5
"""m; points of one line lie at most this far beside those of the other. Maps of one site that were
drawn twice differ by less; lanes lie 3 m apart."""

_BESIDE_PATH = 1.5  # m; paths of vehicles scatter within their lane
_TURNED = np.radians(8.0)
_PROPOSALS = 4  # turns
_MOST_VOTES = 500  # points of a shape that vote
_REACHES = (3.0, 2.0, 1.0, 1.0)  # m; largest distance of a pair, by iteration
_ALIKE = 0.9  # share from which no better placement is looked for
_STRAIGHT = 0.02  # smallest share of directions across the main one that fixes a shift


@dataclass(frozen=True, eq=False)
class Shape:
    """Lines of a recording."""

    points: Float64[np.ndarray, "point 3"]  # x, y in m and direction in rad, every `STEP` metres
    of_road: bool  # whether they are centre lines of lanelets; else paths of vehicles

    @cached_property
    def tree(self) -> Any:
        """Tree of the points' places."""
        return tree_of(self.points[:, :2])


@dataclass(frozen=True, eq=False)
class Placement:
    """Rigid motion from one frame to another."""

    turn: float  # rad, about the origin
    shift: Float64[np.ndarray, " 2"]  # m, after the turn

    def of(self, points: Float64[np.ndarray, "point 3"]) -> Float64[np.ndarray, "point 3"]:
        """Return x, y and direction in the second frame."""
        return np.column_stack(
            [points[:, :2] @ self._matrix.T + self.shift, points[:, 2:] + self.turn]
        )

    def back(self, points: Float64[np.ndarray, "point 3"]) -> Float64[np.ndarray, "point 3"]:
        """Return points of the second frame in the first."""
        moved = (points[:, :2] - self.shift) @ self._matrix
        return np.column_stack([moved, points[:, 2:] - self.turn])

    @property
    def _matrix(self) -> np.ndarray:
        cos = np.cos(self.turn)
        sin = np.sin(self.turn)
        return np.array([[cos, -sin], [sin, cos]])


def shape_of(recording: Recording) -> Shape:
    """Return the centre lines of a recording's lanelets, or the paths of its tracks without any."""
    lanelets = recording.road.lanelets.values()
    tracks = recording.tracks
    lines = [lanelet.centre for lanelet in lanelets] or np.split(
        np.column_stack([tracks.x, tracks.y]), tracks.starts[1:-1]
    )
    points = np.concatenate([np.zeros((0, 3)), *(every_step(line) for line in lines)])
    if lanelets:
        return Shape(points, True)
    # One point for each place and direction, however many vehicles passed it.
    cells = np.round(points / np.array([STEP, STEP, np.pi / 6])).astype(np.int64)
    return Shape(points[np.unique(cells, axis=0, return_index=True)[1]], False)


def shared(first: Shape, second: Shape) -> tuple[float, float]:
    """Return the share of each shape's points that lie on its partner, best aligned.

    Shapes that are straight fit everywhere along themselves, and paths of vehicles scatter: both
    are compared in the frames that they are written in.

    Args:
        first: Lines of one recording.
        second: Lines of the second recording, in a frame that may differ.

    Returns:
        Shares in [0, 1], that of the first shape's points first; 0 if a shape has no point.
    """
    if not len(first.points) or not len(second.points):
        return 0.0, 0.0
    beside = BESIDE if first.of_road and second.of_road else _BESIDE_PATH
    best = _overlap(first, second, Placement(0.0, np.zeros(2)), beside)
    if max(best) > _ALIKE or not (first.of_road and second.of_road):
        return best
    if min(_bends(first.points), _bends(second.points)) < _STRAIGHT:
        return best
    kernel = np.exp(-0.5 * (np.minimum(np.arange(360), 360 - np.arange(360)) / 1.5) ** 2)
    spectra = []
    for shape in (first, second):
        degrees = np.floor(np.degrees(shape.points[:, 2]) % 360).astype(np.int64) % 360
        histogram = np.bincount(degrees, minlength=360).astype(np.float64)
        spectra.append(np.fft.fft(histogram) * np.fft.fft(kernel))
    correlation = np.real(np.fft.ifft(spectra[0] * np.conj(spectra[1])))
    # No turn, and those of the best correlations.
    turns = [0.0]
    for _ in range(_PROPOSALS):
        peak = int(np.argmax(correlation))
        turns.append(np.radians(peak))
        correlation[np.arange(peak - 4, peak + 5) % 360] = -np.inf
    for turn in turns:
        placement = _placed(first, second, turn)
        shares = _overlap(first, second, placement, beside)
        best = max(best, shares, key=max)
        if max(best) > _ALIKE:
            break
    return best


def fits_by_chance(first: Shape, second: Shape, least: float) -> bool:
    """Whether a shape's mirror image fits the second shape as well, and only once it is placed.

    No place is the mirror image of another. A small shape that fits a large one in both forms does
    not show its place. Shapes that agree in the frames that they are written in do.

    Args:
        first: Lines of one recording, which are mirrored.
        second: Lines of the second recording.
        least: Smallest share of either shape's points on its partner that counts as a fit.
    """
    beside = BESIDE if first.of_road and second.of_road else _BESIDE_PATH
    if max(_overlap(first, second, Placement(0.0, np.zeros(2)), beside)) >= least:
        return False
    mirrored = first.points * np.array([-1.0, 1.0, -1.0]) + np.array([0.0, 0.0, np.pi])
    return max(shared(Shape(mirrored, first.of_road), second)) >= least


def _overlap(
    first: Shape, second: Shape, placement: Placement, beside: float
) -> tuple[float, float]:
    """Return the shares of points that lie on each shape's partner, once placed."""
    there = placement.back(first.points)
    here = placement.of(second.points)
    return _on(there, second, beside), _on(here, first, beside)


def _on(points: np.ndarray, lines: Shape, beside: float) -> float:
    distance, nearest = lines.tree.query(points[:, :2], k=min(4, len(lines.points)))
    distance = distance.reshape(len(points), -1)
    nearest = nearest.reshape(len(points), -1)
    near = lines.points[nearest]
    apart = points[:, None, :2] - near[..., :2]
    lateral = apart[..., 1] * np.cos(near[..., 2]) - apart[..., 0] * np.sin(near[..., 2])
    turned = np.abs(wrapped(points[:, None, 2] - near[..., 2])) < _TURNED
    match = (distance < 1.25 * STEP) & (np.abs(lateral) < beside) & turned
    return float(match.any(axis=1).mean())


def _bends(points: np.ndarray) -> float:
    """Return the smaller principal share of the lines' directions; 0 for parallel lines."""
    along = np.column_stack([np.cos(points[:, 2]), np.sin(points[:, 2])])
    return float(np.linalg.eigvalsh(along.T @ along / len(along))[0])


def _placed(fixed: Shape, turning: Shape, turn: float) -> Placement:
    """Return the placement of the turning points on the fixed ones with about this turn."""
    turned = Placement(turn, np.zeros(2)).of(turning.points)
    few, voters = (points[:: 1 + len(points) // _MOST_VOTES] for points in (fixed.points, turned))
    # Cosines cost less than angles, and only those near the limit or above need the angle.
    unit, units = (np.array([np.cos(at[:, 2]), np.sin(at[:, 2])]) for at in (few, voters))
    first, second = np.nonzero(unit.T @ units > np.cos(_TURNED / 2) - 1e-6)
    same = np.abs(wrapped(few[first, 2] - voters[second, 2])) < _TURNED / 2
    first = first[same]
    second = second[same]
    if not len(first):
        return Placement(turn, np.zeros(2))
    votes = np.round((few[first, :2] - voters[second, :2]) / (STEP / 2)).astype(np.int64)
    low = votes.min(axis=0)
    width = int(np.ptp(votes[:, 1])) + 1
    cells, count = np.unique((votes - low) @ np.array([width, 1]), return_counts=True)
    most = np.array(divmod(int(cells[np.argmax(count)]), width)) + low
    placement = Placement(turn, most * (STEP / 2))
    for reach in _REACHES:
        moved = placement.of(turning.points)
        distance, nearest = fixed.tree.query(moved[:, :2])
        line = fixed.points[nearest]
        use = (distance < reach) & (np.abs(wrapped(line[:, 2] - moved[:, 2])) < _TURNED)
        if use.sum() < 5:
            return placement
        moved = moved[use]
        line = line[use]
        across = np.column_stack([-np.sin(line[:, 2]), np.cos(line[:, 2])])
        arm = moved[:, :2] - moved[:, :2].mean(axis=0)
        matrix = np.column_stack([across, arm[:, 0] * across[:, 1] - arm[:, 1] * across[:, 0]])
        off = ((line[:, :2] - moved[:, :2]) * across).sum(axis=1)
        *step, turn = np.linalg.lstsq(matrix, off, rcond=None)[0]
        # The turn is about the middle of the pairs.
        middle = moved[:, :2].mean(axis=0)
        about = Placement(float(turn), np.zeros(2))
        shift = about.of(np.array([[*(placement.shift - middle), 0.0]]))[0, :2] + middle
        placement = Placement(placement.turn + float(turn), shift + np.array(step))
    return placement


SAME_SPEED = 0.06  # m/s; largest difference of two speeds in a second that is proposed as the same
SAME_PLACE = 0.5  # m; largest median distance of the same vehicle in two recordings
FEWEST_STATES = 5  # states in common that identify a vehicle, once clocks and frames are aligned
_CHANGE = 0.3  # m/s; a second with less change of speed proposes nothing
_STRIDES = 5  # of a second's descriptor
_LAGS = 5  # lags that are tried
_TRIALS = 12  # pairs of vehicles whose paths propose a placement, for each lag
_LEAST_SHARE = 0.5  # of the states in common view that must have a partner
_ALONE = 3.0  # s in common that identify a vehicle, but no walker, without a second one
_LEAST_PATH = 3.0  # m; shorter paths fix no turn
_COMMON_STEP = 0.1  # s, of recordings with different steps


@dataclass(frozen=True, eq=False)
class Common:
    """Moments in common of two recordings."""

    lag: float  # s; time of the second recording at frame 0 of the first
    seconds: float  # duration in common
    vehicles: Int64[np.ndarray, "vehicle 2"]  # track numbers, of the first and of the second


class Motion:
    """Tracks prepared for comparisons, with the speed of each state, m/s."""

    def __init__(self, tracks: Tracks) -> None:
        self.tracks = tracks
        self.speed = np.hypot(tracks.vx, tracks.vy)
        self._length = _STRIDES * max(1, round(1.0 / _STRIDES / tracks.dt))  # frames of a second

    @cached_property
    def seconds(self) -> tuple[Int64[np.ndarray, " window"], Float64[np.ndarray, "window speed"]]:
        """First rows of all seconds of a track, and the speeds in them."""
        rows = np.arange(max(self.tracks.n_states - self._length, 0))
        rows = rows[self.tracks.track[rows] == self.tracks.track[rows + self._length]]
        speeds = self.speed[rows[:, None] + np.arange(_STRIDES + 1) * (self._length // _STRIDES)]
        changing = np.ptp(speeds, axis=1) >= _CHANGE
        return rows[changing], speeds[changing]

    @cached_property
    def proposed(self) -> Int64[np.ndarray, " window"]:
        """Windows that are looked for: the most changing one of each track and second."""
        rows, speeds = self.seconds
        group = self.tracks.track[rows].astype(np.int64) * (1 << 32)
        group += self.tracks.frame[rows] // self._length
        order = np.lexsort([-np.ptp(speeds, axis=1), group])
        return order[np.unique(group[order], return_index=True)[1]]

    @cached_property
    def tree(self) -> Any:
        """Tree of all windows' speeds."""
        return tree_of(self.seconds[1])

    @cached_property
    def by_time(self) -> Any:
        """Tree of all states' places, with a third axis that separates frames."""
        return tree_of(self.places(0))

    def places(self, lag: int) -> Float64[np.ndarray, "state 3"]:
        """Return x, y and the frame, lag frames later, on an axis that separates frames."""
        far = (self.tracks.frame + float(lag)) * (4 * SAME_PLACE)
        return np.column_stack([self.tracks.x, self.tracks.y, far])

    def resampled(self) -> Motion:
        """Return the tracks with states every 0.1 s, linear in between."""
        tracks = self.tracks
        step = _COMMON_STEP
        columns: dict[str, list[np.ndarray]] = {name: [] for name in STATES}
        for track, first in enumerate(tracks.starts[:-1]):
            rows = slice(first, tracks.starts[track + 1])
            time = tracks.frame[rows] * tracks.dt
            frame = np.arange(np.ceil(time[0] / step - 1e-9), np.floor(time[-1] / step + 1e-9) + 1)
            frame = frame if len(frame) else np.array([np.round(time[0] / step)])
            columns["track"].append(np.full(len(frame), track, np.int32))
            columns["frame"].append(frame.astype(np.int32))
            for name in ("x", "y", "vx", "vy"):
                columns[name].append(np.interp(frame * step, time, getattr(tracks, name)[rows]))
            columns["heading"].append(np.zeros(len(frame)))
        states = {name: np.concatenate(pieces) for name, pieces in columns.items()}
        return Motion(replace(tracks, **states, dt=step))


def in_common(motion: Motion, other_motion: Motion) -> Common | None:
    """=

    Recordings with different steps between frames are compared every 0.1 s.

    Args:
        motion: Tracks of one recording.
        other_motion: Tracks of the second recording, whose frame and clock may differ.

    Returns:
        The lag of the clocks, the duration in common and the vehicles that both recordings show,
        one row of two track numbers for each.
    """
    if abs(motion.tracks.dt - other_motion.tracks.dt) > 1e-9:
        motion = motion.resampled()
        other_motion = other_motion.resampled()
    rows, speeds = motion.seconds
    chosen = motion.proposed
    other_rows = other_motion.seconds[0]
    if not len(chosen) or not len(other_rows):
        return None
    # Pairs of tracks with a second of equal speeds, and the lag in frames of each.
    near = other_motion.tree.query_ball_point(speeds[chosen], SAME_SPEED, p=np.inf)
    states = np.repeat(rows[chosen], [len(windows) for windows in near])
    other_states = other_rows[np.concatenate([*near, []]).astype(np.int64)]
    tracks = motion.tracks
    tracks_there = other_motion.tracks
    pairs = np.column_stack([tracks.track[states], tracks_there.track[other_states]]).astype(
        np.int64
    )
    lags = tracks_there.frame[other_states].astype(np.int64) - tracks.frame[states]
    best: tuple[float, Common] | None = None
    for lag in _most_frequent(lags)[0][:_LAGS].tolist():
        for pair in _most_frequent(pairs[lags == lag])[0][:_TRIALS]:
            placement = _placement(motion, other_motion, pair, lag)
            match = None if placement is None else _matched(motion, other_motion, placement, lag)
            if match is not None and (best is None or match[0] > best[0]):
                best = match
        if best is not None and best[0] > 2 * _LEAST_SHARE * 0.9:
            break
    return None if best is None else best[1]


def _most_frequent(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct rows and their counts, the most frequent first."""
    distinct, counts = np.unique(values, axis=0, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return distinct[order], counts[order]


def _placement(
    motion: Motion, other_motion: Motion, pair: np.ndarray, lag: int
) -> Placement | None:
    """Return the rigid motion of a vehicle's path to its other one (Kabsch 1976, in the plane)."""
    # The rows of both tracks at their common times.
    start, end = motion.tracks.starts[pair[0] : pair[0] + 2].tolist()
    other_start, other_end = other_motion.tracks.starts[pair[1] : pair[1] + 2].tolist()
    first = int(motion.tracks.frame[start])
    other_first = int(other_motion.tracks.frame[other_start]) - lag
    begin = max(first, other_first)
    count = min(first + end - start, other_first + other_end - other_start) - begin
    if max(count, 0) * motion.tracks.dt < 1.0 - 1e-9:
        return None
    start = start + begin - first
    other_start = other_start + begin - other_first
    rows = slice(start, start + count)
    other_rows = slice(other_start, other_start + count)
    speeds = np.abs(motion.speed[rows] - other_motion.speed[other_rows])
    a = np.column_stack([motion.tracks.x[rows], motion.tracks.y[rows]])
    b = np.column_stack([other_motion.tracks.x[other_rows], other_motion.tracks.y[other_rows]])
    if np.median(speeds) > SAME_SPEED or np.hypot(*np.ptp(a, axis=0)) < _LEAST_PATH:
        return None
    centre = a.mean(axis=0)
    other_centre = b.mean(axis=0)
    a = a - centre
    b = b - other_centre
    turn = np.arctan2((b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]).sum(), (a * b).sum())
    about = Placement(float(turn), np.zeros(2))
    shift = centre - about.of(np.array([[*other_centre, 0.0]]))[0, :2]
    off = about.of(np.column_stack([b, np.zeros(len(b))]))[:, :2] - a
    return Placement(float(turn), shift) if np.median(np.hypot(*off.T)) <= SAME_PLACE else None


def _matched(
    motion: Motion, other_motion: Motion, placement: Placement, lag: int
) -> tuple[float, Common] | None:
    """Return the share of the common view with a partner, and the vehicles in common."""
    places = other_motion.places(-lag)
    moved = placement.of(places[:, [0, 1, 1]])[:, :2]
    distance, nearest = motion.by_time.query(
        np.column_stack([moved, places[:, 2]]), distance_upper_bound=SAME_PLACE
    )
    met = np.isfinite(distance)
    if met.sum() < FEWEST_STATES:
        return None
    # States with a partner, of those that both recordings could have seen.
    frames = motion.tracks.frame + lag
    points = motion.places(0)[:, :2]
    inside = _within(moved, points) & np.isin(other_motion.tracks.frame, frames)
    covered = _within(points, moved) & np.isin(frames, other_motion.tracks.frame)
    fewer = min(int(inside.sum()), int(covered.sum()))
    share = float(met.sum()) / fewer if fewer else 0.0
    if share < _LEAST_SHARE:
        return None
    pairs = np.column_stack(
        [motion.tracks.track[np.asarray(nearest)[met]], other_motion.tracks.track[met]]
    )
    distinct, counts = _most_frequent(pairs.astype(np.int64))
    rows = [
        row
        for row in np.flatnonzero(counts >= FEWEST_STATES).tolist()
        if not (distinct[:row] == distinct[row]).any()
    ]
    alone = motion.tracks.road_user[distinct[0, 0]] in VEHICLES  # walkers are too much alike
    if not rows or (len(rows) < 2 and (counts[0] * motion.tracks.dt < _ALONE or not alone)):
        return None
    count = len(np.unique(other_motion.tracks.frame[met]))
    common = Common(lag * motion.tracks.dt, count * motion.tracks.dt, distinct[rows])
    return share * count, common


def _within(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Whether points lie in the axis-parallel box around others."""
    low = box.min(axis=0) - SAME_PLACE
    high = box.max(axis=0) + SAME_PLACE
    return ((points >= low) & (points <= high)).all(axis=1)
