"""Physical plausibility of tracks: sizes, displacements, speeds, directions, overlaps.

The tolerances follow from the stated errors of the measurement. A track that fails is left out with
its reason. If most tracks fail in the same way, the file is refused and the unit that explains it
is named.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.errors import UserError
from socialiq.physics import overlap_depth, wrapped
from socialiq_recordings.recording import FARTHEST, Refused, RoadUser, Tracks
from socialiq_recordings.road.network import tree_of

COVERAGE = 3.0
"""Standard errors that a difference may be before it is taken as an error of the file; three hold
99.7 % of normal differences (JCGM 100:2008, G.3)."""

_TURNING = 14.0
"""Degrees; angle between heading and motion of the middle of a car of 5 m that turns with a radius
of 6 m, whose rear axle moves along the heading: atan(1.5 / 6)."""


@dataclass(frozen=True)
class MeasurementError:
    """Standard errors of a source's measurement; the defaults are assumed where it states none.

    Raises:
        UserError: If one is not a number above 0.
    """

    position: float = 0.25  # m, in each direction, independent from frame to frame (the worst case)
    speed: float = 0.25  # m/s
    heading: float = 2.0  # degrees
    size: float = 0.2  # m, of length and width
    scale: float = 0.05  # relative, of distances: a picture is not equally large everywhere

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 < value < math.inf:
                raise UserError(f"error of {field.name} must be a number above 0, got {value:g}")

    def mean_speed(self, seconds: float, driven: float) -> float:
        """Return the largest difference of driven and stated mean speed over a time, m/s.

        The driven distance is a difference of two positions.

        Args:
            seconds: The time, s.
            driven: Speed of the driven distance, m/s.
        """
        positions = math.sqrt(2.0) * self.position / seconds
        return COVERAGE * math.hypot(self.speed, positions, self.scale * driven)

    def jump(self, dt: float) -> float:
        """Return the largest excess of a displacement between frames over the stated, m."""
        return COVERAGE * math.hypot(math.sqrt(2.0) * self.position, self.speed * dt)

    @property
    def direction(self) -> float:
        """Largest angle between heading and motion, rad."""
        return math.radians(_TURNING + COVERAGE * self.heading)

    @property
    def turned(self) -> float:
        """Shortest displacement that errors of two positions turn by less than `direction`, m."""
        return COVERAGE * math.sqrt(2.0) * self.position / math.sin(self.direction)

    @property
    def overlap(self) -> float:
        """Largest depth by which two boxes overlap although the vehicles do not touch, m.

        The depth is a difference of two positions, less half a side of each box.
        """
        return COVERAGE * math.hypot(math.sqrt(2.0) * self.position, self.size / math.sqrt(2.0))


FASTEST = 70.0  # m/s; 252 km/h
MOVING = 2.0  # m/s; directions are checked where driven and stated speeds are at least this
FEWEST_STEPS = 3  # directions of a track with fewer moving seconds are not checked
LONGEST = 30.0  # m; road trains are as long
WIDEST = 4.5  # m; wide loads are as wide
SHORTEST = 0.2  # m; a pedestrian's box
_FOOT = 0.3048

_RATIOS = {
    1 / _FOOT: "positions are in feet",
    _FOOT: "velocities are in feet per second",
    1 / 3.6: "velocities are in km/h",
    0.44704: "velocities are in miles per hour",
}
"""Explanations of the ratio of driven to stated speed."""

_HEADINGS = {
    "degrees, read as radians": lambda heading: np.radians(heading),
    "radians, read as degrees": lambda heading: np.degrees(heading),
    "clockwise: does y point down?": lambda heading: -heading,
    "clockwise from north": lambda heading: np.pi / 2 - heading,
}


def sift(tracks: Tracks, error: MeasurementError | None = None) -> tuple[Tracks, list[Refused]]:
    """Leave out the tracks that are physically impossible.

    Returns:
        The other tracks, and the reason for each refused track.

    Raises:
        UserError: If no track is left, or most fail in a way that a wrong unit explains.
    """
    error = error or MeasurementError()
    far = np.zeros(tracks.n_tracks, bool)
    for column in (tracks.x, tracks.y, tracks.vx, tracks.vy):
        far[tracks.track[np.abs(column) > FARTHEST]] = True
    if far.all():
        raise UserError(f"every track has a position or velocity above {FARTHEST:g}: not metres")
    reason = f"a position or velocity is above {FARTHEST:g}"
    refused = [_refused(tracks, track, reason) for track in np.flatnonzero(far).tolist()]
    tracks = tracks.select(~far) if far.any() else tracks
    reasons = np.full(tracks.n_tracks, "", object)
    bad = _wrong_size(tracks, 1.0)
    if 2 * bad.sum() > len(bad) and 2 * _wrong_size(tracks, _FOOT)[bad].sum() < bad.sum():
        raise UserError(
            f"{bad.sum()} of {len(bad)} tracks have impossible sizes, which are possible in feet: "
            "give sizes in metres, or say that they are in feet"
        )
    for track in np.flatnonzero(bad):
        reasons[track] = (
            f"{tracks.length[track]:.3g} m long and {tracks.width[track]:.3g} m wide: "
            f"no road user is ({SHORTEST} to {LONGEST:g} m long, to {WIDEST} m wide)"
        )
    _check_jumps(tracks, error, reasons)
    _check_speeds(tracks, error, reasons)
    _check_directions(tracks, error, reasons)
    if (reasons == "").any():
        _check_overlaps(tracks, error, reasons)
    good = reasons == ""
    refused += [_refused(tracks, track, reasons[track]) for track in np.flatnonzero(~good).tolist()]
    if not good.any():
        raise UserError(
            f"none of the {len(refused)} tracks can be true; the first, {refused[0].identity}: "
            f"{refused[0].reason}"
        )
    return tracks.select(good), refused


def _refused(tracks: Tracks, track: int, reason: str) -> Refused:
    kind = RoadUser(tracks.road_user[track]).name.lower()
    return Refused(str(tracks.identity[track]), reason, kind)


def _check_jumps(tracks: Tracks, error: MeasurementError, reasons: np.ndarray) -> None:
    row = np.flatnonzero(np.diff(tracks.track) == 0)
    speed = np.hypot(tracks.vx, tracks.vy)
    driven = np.hypot(np.diff(tracks.x)[row], np.diff(tracks.y)[row]) / tracks.dt
    stated = (speed[row] + speed[row + 1]) / 2
    further = (driven - stated) * tracks.dt
    for step in np.flatnonzero(further > error.jump(tracks.dt)):
        if reasons[tracks.track[row[step]]] == "":
            reasons[tracks.track[row[step]]] = (
                f"jumps {further[step]:.2f} m further than its speed allows after frame "
                f"{tracks.frame[row[step]]}"
            )


def _axis_angle(difference: np.ndarray) -> np.ndarray:
    """Return the angle between two axes, in [0, π/2], which ignores reversing."""
    angle = np.abs(wrapped(difference))
    return np.minimum(angle, np.pi - angle)


def _wrong_size(tracks: Tracks, unit: float) -> Bool[np.ndarray, " track"]:
    length = tracks.length * unit
    width = tracks.width * unit
    # A person may be wider than long, so the smaller of the two is checked.
    return (np.minimum(length, width) < SHORTEST) | (length > LONGEST) | (width > WIDEST)


def _check_speeds(tracks: Tracks, error: MeasurementError, reasons: np.ndarray) -> None:
    """Compare the distances of about a second with the integrals of the stated velocities."""
    driven, stated, apart, seconds = _seconds(tracks)
    times = np.maximum(seconds, tracks.dt).tolist()
    pairs = zip(times, driven.tolist(), strict=True)
    allowed = np.array([error.mean_speed(time, speed) for time, speed in pairs])
    bad = apart > allowed
    moves = np.maximum(driven, stated) > MOVING
    if 2 * (bad & moves).sum() > max(moves.sum(), 1):
        ratio = float(np.median(driven[bad & moves] / np.maximum(stated[bad & moves], 1e-9)))
        nearest = min(_RATIOS, key=lambda track: abs(ratio / track - 1))
        unit = _RATIOS[nearest] if abs(ratio / nearest - 1) < 0.1 else ""
        raise UserError(
            f"in {(bad & moves).sum()} of {moves.sum()} moving tracks the driven speed is about "
            f"{ratio:.3g} times the stated one: "
            f"{unit or 'positions, velocities or the frame rate have another unit'}"
        )
    for track in np.flatnonzero(bad & (reasons == "")):
        reasons[track] = (
            f"drives {driven[track]:.2f} m/s but states {stated[track]:.2f} (means; "
            f"{apart[track]:.2f} apart in {seconds[track]:g} s, where {allowed[track]:.2f} may be "
            "measurement)"
        )
    fastest = np.zeros(tracks.n_tracks)
    np.maximum.at(fastest, tracks.track, np.hypot(tracks.vx, tracks.vy))
    for track in np.flatnonzero((fastest > FASTEST) & (reasons == "")):
        reasons[track] = f"states {fastest[track]:.1f} m/s, more than {FASTEST:g}"


def _seconds(tracks: Tracks) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return driven and stated speeds over a second, their distance, and the time, by track."""
    starts = tracks.starts
    n = tracks.n_tracks
    frames = np.minimum(max(1, round(1 / tracks.dt)), np.diff(starts) - 1)
    rows = np.arange(tracks.n_states)
    rows = rows[rows + frames[tracks.track] < starts[1:][tracks.track]]
    rows = rows[frames[tracks.track[rows]] > 0]
    track = tracks.track[rows].astype(np.int64)
    after = rows + frames[track]
    time = frames[track] * tracks.dt
    driven = np.hypot(tracks.x[after] - tracks.x[rows], tracks.y[after] - tracks.y[rows]) / time
    integrals = []
    for velocity in (tracks.vx, tracks.vy):
        # The integral by the trapezoidal rule; differences across tracks are never used, and an
        # absurd velocity must not cost the sums of the others their digits.
        velocity = np.clip(velocity, -1e4, 1e4)
        steps = (velocity[:-1] + velocity[1:]) / 2 * tracks.dt
        along = np.concatenate([[0.0], np.cumsum(steps)])
        integrals.append(along[after] - along[rows])
    stated = np.hypot(*integrals) / time
    counts = np.maximum(np.bincount(track, minlength=n), 1)
    columns = driven, stated, np.abs(driven - stated)
    a, b, c = (np.bincount(track, values, n) / counts for values in columns)
    return a, b, c, frames * tracks.dt


def _check_directions(tracks: Tracks, error: MeasurementError, reasons: np.ndarray) -> None:
    """Compare directions over about a second with those of the displacement.

    Judged where the file, too, says that a road user moves, and where the displacement is so long
    that errors of positions turn it by less than a direction may err: a parked car's box jitters.
    """
    frames = max(1, round(1 / tracks.dt))
    row = np.flatnonzero(np.diff(tracks.track) == 0)
    after = np.minimum(row + frames, tracks.starts[1:][tracks.track[row]] - 1)
    dx = tracks.x[after] - tracks.x[row]
    dy = tracks.y[after] - tracks.y[row]
    track = tracks.track[row].astype(np.int64)
    direction = np.arctan2(dy, dx)
    distance = np.hypot(dx, dy)
    vx, vy, east, north = (
        _sums(values, row, after)
        for values in (tracks.vx, tracks.vy, np.cos(tracks.heading), np.sin(tracks.heading))
    )
    velocity = np.arctan2(vy, vx)
    heading = np.arctan2(north, east)
    count = after - row
    moving = distance >= np.maximum(MOVING * count * tracks.dt, error.turned)
    moving &= np.hypot(vx, vy) >= MOVING * (count + 1)
    # People walk backwards and sideways, and their boxes have no front.
    along = moving & (tracks.road_user != RoadUser.PEDESTRIAN)[track]
    for name, angles, rows in (
        ("heading", _axis_angle(direction - heading), along),
        ("velocity", np.abs(wrapped(direction - velocity)), moving),
    ):
        medians = _medians(angles[rows], track[rows], tracks.n_tracks)
        bad = medians > error.direction
        checked = ~np.isnan(medians)
        if 2 * bad.sum() > max(checked.sum(), 1):
            fault = (
                "does not point the way they move: do positions and velocities have the same axes, "
                "and does y point up?"
            )
            if name == "heading":
                headings = "wrong, or the axes of positions are not those of headings"
                for words, read in _HEADINGS.items():
                    if "as degrees" in words and np.abs(heading[along]).max() > np.radians(
                        2 * np.pi
                    ):
                        continue  # A full turn in radians is the number 6.28, which is 6 degrees.
                    angle = _axis_angle(direction[along] - read(heading[along]))
                    explained = _medians(angle, track[along], tracks.n_tracks) <= error.direction
                    if 2 * explained.sum() > checked.sum():
                        headings = words
                        break
                fault = f"is not the way they move: headings are {headings}"
            raise UserError(f"in {bad.sum()} of {checked.sum()} tracks the {name} {fault}")
        for number in np.flatnonzero(bad & (reasons == "")):
            degrees = np.degrees(medians[number])
            reasons[number] = f"{name} {degrees:.0f}° off the way it moves (median)"


def _sums(values: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return the sums from a row to another, both included."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return sums[last + 1] - sums[first]


def _medians(values: np.ndarray, track: np.ndarray, n_tracks: int) -> Float64[np.ndarray, " track"]:
    """Return the median by track, NaN for fewer than `FEWEST_STEPS`; rows in order of tracks."""
    medians = np.full(n_tracks, np.nan)
    ends = np.searchsorted(track, np.arange(n_tracks + 1))
    for number in np.flatnonzero(np.diff(ends) >= FEWEST_STEPS):
        medians[number] = np.median(values[ends[number] : ends[number + 1]])
    return medians


def _check_overlaps(tracks: Tracks, error: MeasurementError, reasons: np.ndarray) -> None:
    """Refuse both tracks of an overlap, because either may be wrong; a trailer is no overlap."""
    good = reasons == ""
    plausible = tracks.select(good)
    numbers = np.flatnonzero(good)
    pairs = overlaps(plausible)
    hitched: dict[tuple[int, int], bool] = {}
    # The deepest first: it is reported.
    for pair in np.argsort(-pairs.depth, kind="stable"):
        if pairs.depth[pair] <= error.overlap:
            break
        rows = int(pairs.first[pair]), int(pairs.second[pair])
        front, rear = (int(plausible.track[row]) for row in rows)
        if (front, rear) not in hitched:
            hitched[front, rear] = _hitched(plausible, front, rear, error)
        if hitched[front, rear]:
            continue
        for row, beside in (rows, rows[::-1]):
            track = numbers[plausible.track[row]]
            if reasons[track] == "":
                reasons[track] = (
                    f"overlaps by {pairs.depth[pair]:.2f} m with "
                    f"{plausible.identity[plausible.track[beside]]} at frame {plausible.frame[row]}"
                )


class Overlaps(NamedTuple):
    """Pairs of rows of a frame whose rectangles overlap, and the depth, m.

    The depth is the smallest displacement that would separate the rectangles.
    """

    first: Int64[np.ndarray, " pair"]
    second: Int64[np.ndarray, " pair"]
    depth: Float64[np.ndarray, " pair"]


_BLOCK = 100_000  # states whose pairs are held in memory at a time


def overlaps(tracks: Tracks) -> Overlaps:
    """Return all overlaps of a recording (`physics.overlap_depth`)."""
    order = np.argsort(tracks.frame, kind="stable")
    frames = tracks.frame[order]
    blocks = []
    begin = 0
    while begin < len(order):
        # A block ends with a frame.
        last = frames[min(begin + _BLOCK, len(order)) - 1]
        end = int(np.searchsorted(frames, last, side="right"))
        blocks.append(_overlaps_of(tracks, order[begin:end]))
        begin = end
    return Overlaps(*(np.concatenate(column) for column in zip(*blocks, strict=True)))


def _overlaps_of(tracks: Tracks, rows: Int64[np.ndarray, " row"]) -> Overlaps:
    half = np.stack([tracks.length, tracks.width], axis=1) / 2
    radius = np.hypot(half[:, 0], half[:, 1])
    reach = 2 * radius.max()
    # A third axis separates frames, so that states of different frames are never near.
    frames = (tracks.frame[rows] - tracks.frame[rows].min()) * (2 * reach)
    points = np.stack([tracks.x[rows], tracks.y[rows], frames], axis=1)
    first, second = rows[tree_of(points).query_pairs(reach, output_type="ndarray")].T
    distance = np.hypot(tracks.x[second] - tracks.x[first], tracks.y[second] - tracks.y[first])
    near = distance < radius[tracks.track[first]] + radius[tracks.track[second]]
    first = first[near]
    second = second[near]
    depth = overlap_depth(
        tracks.x[second] - tracks.x[first],
        tracks.y[second] - tracks.y[first],
        tracks.heading[first],
        tracks.heading[second],
        *half[tracks.track[first]].T,
        *half[tracks.track[second]].T,
    )
    touch = depth > 0
    return Overlaps(first[touch], second[touch], depth[touch])


def _hitched(tracks: Tracks, front: int, rear: int, error: MeasurementError) -> bool:
    """Whether two tracks are a vehicle and its trailer.

    A hitch is a point at a fixed place on the axes of both. Least squares over all moments find the
    two places; the two points then agree within the error of positions. Neither middle is inside
    the box of its partner, and they drive further than they are long, which two boxes of one
    vehicle or two that were parked do not show.
    """
    starts = tracks.starts
    spans = [slice(starts[track], starts[track + 1]) for track in (front, rear)]
    frames = [tracks.frame[span] for span in spans]
    _, first, second = np.intersect1d(frames[0], frames[1], return_indices=True)
    rows = spans[0].start + first, spans[1].start + second
    centre, axis = (
        [np.stack([a[row], b[row]], axis=1) for row in rows]
        for a, b in ((tracks.x, tracks.y), (np.cos(tracks.heading), np.sin(tracks.heading)))
    )
    apart = centre[1] - centre[0]
    axes = np.stack([axis[0].ravel(), axis[1].ravel()], axis=1)
    lengths = np.linalg.lstsq(axes, apart.ravel(), rcond=None)[0]
    off = (axes @ lengths - apart.ravel()).reshape(-1, 2)
    driven = np.hypot(*np.ptp(centre[0], axis=0))
    sizes = tracks.length[front], tracks.length[rear]
    return bool(
        driven > sum(sizes)
        and np.hypot(*apart.T).min() > max(sizes) / 2
        and np.sqrt((off**2).sum(axis=1).mean()) <= COVERAGE * math.sqrt(2.0) * error.position
    )
