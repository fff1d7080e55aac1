"""Physical plausibility of tracks: speeds, displacements, headings, sizes, overlaps.

The tolerances follow from the stated errors of the measurement (`measurement`). A track that fails
is left out with its reason. If most tracks fail in the same way, the file is refused and the unit
that explains it is named.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import KDTree

from socialiq.errors import UserError
from socialiq_recordings.measurement import MeasurementError
from socialiq_recordings.recording import FARTHEST, Refused, RoadUser, Tracks


class Overlaps(NamedTuple):
    """Pairs of states of a frame whose rectangles overlap.

    Attributes:
        first: Row of the first state.
        second: Row of the second state.
        depth: Smallest displacement that would separate them, m.
    """

    first: Int64[np.ndarray, " pair"]
    second: Int64[np.ndarray, " pair"]
    depth: Float64[np.ndarray, " pair"]


_BLOCK = 100_000  # states whose pairs are held in memory at a time


def overlaps(tracks: Tracks) -> Overlaps:
    """Return all overlaps of a recording, by the separating axes of two rectangles.

    Two rectangles are disjoint exactly if an axis along a side of one of them separates them
    (Gottschalk, Lin and Manocha, SIGGRAPH 1996). The smallest overlap on the four axes is the
    depth.
    """
    order = np.argsort(tracks.frame, kind="stable")
    frames = tracks.frame[order]
    blocks, begin = [], 0
    while begin < len(order):
        # A block ends with a frame.
        last = frames[min(begin + _BLOCK, len(order)) - 1]
        end = int(np.searchsorted(frames, last, side="right"))
        blocks.append(_overlaps_of(tracks, order[begin:end]))
        begin = end
    return Overlaps(*(np.concatenate(column) for column in zip(*blocks, strict=True)))


def _overlaps_of(tracks: Tracks, rows: Int64[np.ndarray, " some"]) -> Overlaps:
    half = np.stack([tracks.length, tracks.width], axis=1) / 2
    first, second = _near_pairs(tracks, rows, np.hypot(half[:, 0], half[:, 1]))
    half_one, half_other = half[tracks.track[first]], half[tracks.track[second]]
    apart = np.stack(
        [tracks.x[second] - tracks.x[first], tracks.y[second] - tracks.y[first]], axis=1
    )
    turned = tracks.heading[second] - tracks.heading[first]
    cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    depth = np.full(len(first), np.inf)
    for own_half, other_half, row in (
        (half_one, half_other, first),
        (half_other, half_one, second),
    ):
        east, north = np.cos(tracks.heading[row]), np.sin(tracks.heading[row])
        along = np.abs(apart[:, 0] * east + apart[:, 1] * north)
        across = np.abs(apart[:, 1] * east - apart[:, 0] * north)
        reach_along = own_half[:, 0] + other_half[:, 0] * cos + other_half[:, 1] * sin
        reach_across = own_half[:, 1] + other_half[:, 0] * sin + other_half[:, 1] * cos
        depth = np.minimum(depth, np.minimum(reach_along - along, reach_across - across))
    touch = depth > 0
    return Overlaps(first[touch], second[touch], depth[touch])


def _near_pairs(
    tracks: Tracks, rows: Int64[np.ndarray, " some"], radius: Float64[np.ndarray, " track"]
) -> tuple[Int64[np.ndarray, " pair"], Int64[np.ndarray, " pair"]]:
    """Return pairs of rows of a frame whose circumscribed circles meet."""
    reach = 2 * radius.max()
    # A third axis separates frames, so that states of different frames are never near.
    frames = (tracks.frame[rows] - tracks.frame[rows].min()) * (2 * reach)
    places = np.stack([tracks.x[rows], tracks.y[rows], frames], axis=1)
    pairs = rows[KDTree(places).query_pairs(reach, output_type="ndarray")]
    first, second = pairs[:, 0], pairs[:, 1]
    distance = np.hypot(tracks.x[second] - tracks.x[first], tracks.y[second] - tracks.y[first])
    meet = distance < radius[tracks.track[first]] + radius[tracks.track[second]]
    return first[meet], second[meet]


FASTEST = 70.0
"""m/s; 252 km/h."""

MOVING = 2.0
"""m/s; directions are checked where the driven speed is at least this."""

FEWEST_STEPS = 3
"""Directions of a track with fewer moving steps are not checked."""

LONGEST, WIDEST = 30.0, 4.5
"""m; road trains are as long, wide loads as wide."""
SHORTEST = 0.2
"""m; a pedestrian's box."""

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

    Args:
        tracks: The tracks.
        error: Standard errors of their measurement.

    Returns:
        The other tracks, and the reason for each refused track.

    Raises:
        UserError: If no track is left, or most fail in a way that a wrong unit explains.
    """
    error = error or MeasurementError()
    tracks, far = _near(tracks)
    reasons = np.full(tracks.n_tracks, "", object)
    steps = _steps(tracks)
    for check in (_check_sizes, _check_jumps, _check_speeds, _check_directions):
        check(tracks, steps, error, reasons)
    good = reasons == ""
    if good.any():
        _check_overlaps(tracks, good, error, reasons)
    refused = [
        Refused(str(tracks.identity[track]), str(reasons[track]))
        for track in np.flatnonzero(reasons != "")
    ]
    refused = far + refused
    if len(refused) == len(far) + tracks.n_tracks:
        raise UserError(
            f"none of the {len(refused)} tracks can be true; the first, {refused[0].identity}: "
            f"{refused[0].reason}"
        )
    return tracks.kept(reasons == ""), refused


class _Steps(NamedTuple):
    """Steps from each state to the next of its track."""

    track: Int64[np.ndarray, " step"]
    row: Int64[np.ndarray, " step"]
    driven: Float64[np.ndarray, " step"]
    stated: Float64[np.ndarray, " step"]
    to_heading: Float64[np.ndarray, " step"]
    to_velocity: Float64[np.ndarray, " step"]
    direction: Float64[np.ndarray, " step"]
    heading: Float64[np.ndarray, " step"]


def _steps(tracks: Tracks) -> _Steps:
    row = np.flatnonzero(np.diff(tracks.track) == 0)
    after = row + 1
    dx, dy = tracks.x[after] - tracks.x[row], tracks.y[after] - tracks.y[row]
    speed = np.hypot(tracks.vx, tracks.vy)
    direction = np.arctan2(dy, dx)
    vx, vy = tracks.vx[row] + tracks.vx[after], tracks.vy[row] + tracks.vy[after]
    east = np.cos(tracks.heading[row]) + np.cos(tracks.heading[after])
    north = np.sin(tracks.heading[row]) + np.sin(tracks.heading[after])
    heading = np.arctan2(north, east)
    return _Steps(
        track=tracks.track[row].astype(np.int64),
        row=row,
        driven=np.hypot(dx, dy) / tracks.dt,
        stated=(speed[row] + speed[after]) / 2,
        to_heading=_axis_angle(direction - heading),
        to_velocity=_angle(direction - np.arctan2(vy, vx)),
        direction=direction,
        heading=heading,
    )


def _angle(difference: np.ndarray) -> np.ndarray:
    """Return the angle between two directions, in [0, π]."""
    return np.abs(np.mod(difference + np.pi, 2 * np.pi) - np.pi)


def _axis_angle(difference: np.ndarray) -> np.ndarray:
    """Return the angle between two axes, in [0, π/2], which ignores reversing."""
    angle = _angle(difference)
    return np.minimum(angle, np.pi - angle)


def _mean(values: np.ndarray, track: np.ndarray, n_tracks: int) -> np.ndarray:
    """Return the mean by track; 0 for a track without steps."""
    counts = np.bincount(track, minlength=n_tracks)
    return np.bincount(track, values, n_tracks) / np.maximum(counts, 1)


def _near(tracks: Tracks) -> tuple[Tracks, list[Refused]]:
    """Return the tracks without numbers that no arithmetic can use, and the others' reasons."""
    far = np.zeros(tracks.n_tracks, bool)
    for column in (tracks.x, tracks.y, tracks.vx, tracks.vy):
        far[tracks.track[np.abs(column) > FARTHEST]] = True
    if far.all():
        raise UserError(f"every track has a position or velocity above {FARTHEST:g}: not metres")
    reason = f"a position or velocity is above {FARTHEST:g}"
    refused = [Refused(str(tracks.identity[track]), reason) for track in np.flatnonzero(far)]
    return (tracks.kept(~far) if far.any() else tracks), refused


def _check_sizes(tracks: Tracks, _: _Steps, error: MeasurementError, reasons: np.ndarray) -> None:
    del error  # Sizes of road users, not of their boxes' errors.
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


def _wrong_size(tracks: Tracks, unit: float) -> Bool[np.ndarray, " track"]:
    length, width = tracks.length * unit, tracks.width * unit
    # A person may be wider than long, so the smaller of the two is checked.
    return (np.minimum(length, width) < SHORTEST) | (length > LONGEST) | (width > WIDEST)


def _check_speeds(tracks: Tracks, _: _Steps, error: MeasurementError, reasons: np.ndarray) -> None:
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
    """Return driven and stated speeds over a second, their mean distance, and the time, by track.

    A track that is shorter than a second is taken as a whole.
    """
    starts, n = tracks.starts, tracks.n_tracks
    frames = np.minimum(max(1, round(1 / tracks.dt)), np.diff(starts) - 1)
    rows = np.arange(tracks.n_states)
    rows = rows[rows + frames[tracks.track] < starts[1:][tracks.track]]
    rows = rows[frames[tracks.track[rows]] > 0]
    track = tracks.track[rows].astype(np.int64)
    after, time = rows + frames[track], frames[track] * tracks.dt
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
    apart = np.abs(driven - stated)
    a, b, c = (_mean(values, track, n) for values in (driven, stated, apart))
    return a, b, c, frames * tracks.dt


def _check_jumps(
    tracks: Tracks, steps: _Steps, error: MeasurementError, reasons: np.ndarray
) -> None:
    further = (steps.driven - steps.stated) * tracks.dt
    for step in np.flatnonzero(further > error.jump(tracks.dt)):
        track = steps.track[step]
        if reasons[track] == "":
            reasons[track] = (
                f"jumps {further[step]:.2f} m further than its speed allows after frame "
                f"{tracks.frame[steps.row[step]]}"
            )


def _check_directions(
    tracks: Tracks, steps: _Steps, error: MeasurementError, reasons: np.ndarray
) -> None:
    moving = steps.driven >= MOVING
    # People walk backwards and sideways, and their boxes have no front.
    walks = tracks.road_user == RoadUser.PEDESTRIAN
    along = moving & ~walks[steps.track]
    medians = _medians(steps.to_heading[along], steps.track[along], tracks.n_tracks)
    bad, checked = medians > error.direction, ~np.isnan(medians)
    if 2 * bad.sum() > max(checked.sum(), 1):
        raise UserError(
            f"in {bad.sum()} of {checked.sum()} tracks the heading is not the way they move: "
            f"{_headings_read_as(steps, along, tracks.n_tracks, error)}"
        )
    for track in np.flatnonzero(bad & (reasons == "")):
        reasons[track] = f"heading {np.degrees(medians[track]):.0f}° off the way it moves (median)"
    medians = _medians(steps.to_velocity[moving], steps.track[moving], tracks.n_tracks)
    bad, checked = medians > error.direction, ~np.isnan(medians)
    if 2 * bad.sum() > max(checked.sum(), 1):
        raise UserError(
            f"in {bad.sum()} of {checked.sum()} tracks the velocity does not point the way they "
            "move: do positions and velocities have the same axes, and does y point up?"
        )
    for track in np.flatnonzero(bad & (reasons == "")):
        reasons[track] = f"velocity {np.degrees(medians[track]):.0f}° off the way it moves (median)"


def _headings_read_as(
    steps: _Steps, along: np.ndarray, n_tracks: int, error: MeasurementError
) -> str:
    for words, read in _HEADINGS.items():
        if "as degrees" in words and np.abs(steps.heading[along]).max() > np.radians(2 * np.pi):
            continue  # A full turn in radians is the number 6.28, which is 6 degrees.
        angle = _axis_angle(steps.direction[along] - read(steps.heading[along]))
        medians = _medians(angle, steps.track[along], n_tracks)
        if 2 * (medians <= error.direction).sum() > (~np.isnan(medians)).sum():
            return f"headings are {words}"
    return "headings are wrong, or the axes of positions are not those of headings"


def _medians(values: np.ndarray, track: np.ndarray, n_tracks: int) -> Float64[np.ndarray, " track"]:
    """Return the median by track, NaN for fewer than `FEWEST_STEPS`; rows in order of tracks."""
    medians = np.full(n_tracks, np.nan)
    ends = np.searchsorted(track, np.arange(n_tracks + 1))
    for number in np.flatnonzero(np.diff(ends) >= FEWEST_STEPS):
        medians[number] = np.median(values[ends[number] : ends[number + 1]])
    return medians


def _check_overlaps(
    tracks: Tracks,
    good: Bool[np.ndarray, " track"],
    error: MeasurementError,
    reasons: np.ndarray,
) -> None:
    """Refuse both tracks of an overlap, because either may be wrong."""
    plausible, numbers = tracks.kept(good), np.flatnonzero(good)
    pairs = overlaps(plausible)
    # The deepest first: it is reported.
    for pair in np.argsort(-pairs.depth, kind="stable"):
        if pairs.depth[pair] <= error.overlap:
            break
        rows = int(pairs.first[pair]), int(pairs.second[pair])
        for row, beside in (rows, rows[::-1]):
            track = numbers[plausible.track[row]]
            if reasons[track] == "":
                reasons[track] = (
                    f"overlaps by {pairs.depth[pair]:.2f} m with "
                    f"{plausible.identity[plausible.track[beside]]} at frame {plausible.frame[row]}"
                )
