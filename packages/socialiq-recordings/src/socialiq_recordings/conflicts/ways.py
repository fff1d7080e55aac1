"""Ways of vehicles: the line that each drove, continued along its route, and when it was where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from socialiq_recordings.road.paths import Polyline
from socialiq_recordings.road.routes import AHEAD, Scene

SPACING = 1.0  # m between the points of a driven line; shorter steps are noise of the positions
BEHIND = 10.0  # m of straight line before the first state
SMOOTHED = 1.0  # s; speeds over shorter times are mostly error in recordings from video
_ON_ROUTE = 3.5  # m; further beside its route a line goes straight on
_RETURN = 20.0  # m in which a line returns to the middle of its lane
_STEP = 2.0  # m between the points of a continued line


@dataclass(frozen=True, eq=False)
class Way:
    """Way of a vehicle.

    Attributes:
        track: Number of the track.
        first: Its first frame.
        line: Line of the vehicle's middle: `BEHIND` m before its first state, the driven line,
            and up to `AHEAD` m along its route.
        along: Coordinate on the line at each frame, m; never decreases.
        speed: Along the line, at each frame, m/s: the distance driven over `SMOOTHED`.
        length: Of the vehicle, m.
        width: Of the vehicle, m.
        lanelets: Numbers of the lanelets on its route.
        dt: s between frames.
    """

    track: int
    first: int
    line: Polyline
    along: Float64[np.ndarray, " state"]
    speed: Float64[np.ndarray, " state"]
    length: float
    width: float
    lanelets: tuple[int, ...]
    dt: float

    @property
    def last(self) -> int:
        """Last frame."""
        return self.first + len(self.along) - 1

    def state(self, frame: int) -> tuple[float, float]:
        """Return coordinate and speed at a frame."""
        return float(self.along[frame - self.first]), float(self.speed[frame - self.first])

    def reached(self, coordinate: float) -> float:
        """Return the frame, with a fraction, at which the middle reached a coordinate.

        Returns:
            Minus infinity if it was beyond already at its first frame, infinity if it had not
            reached it at its last.
        """
        if coordinate < self.along[0]:
            return -np.inf
        if coordinate > self.along[-1]:
            return np.inf
        place = int(np.searchsorted(self.along, coordinate, side="left"))
        if place == 0:
            return float(self.first)
        before, after = self.along[place - 1 : place + 1].tolist()
        return self.first + place - 1 + (coordinate - before) / (after - before)


def way_of(scene: Scene, track: int) -> Way:
    """Return a vehicle's way.

    Args:
        scene: The recording.
        track: Number of the track.
    """
    tracks, rows = scene.tracks, scene.rows(track)
    points = np.stack([tracks.x[rows], tracks.y[rows]], axis=1)
    kept = [points[0]]
    for point in points[1:]:
        if np.hypot(*(point - kept[-1])) >= SPACING:
            kept.append(point)
    driven = np.array(kept)
    heading = float(tracks.heading[rows.start])
    back = driven[0] - BEHIND * np.array([np.cos(heading), np.sin(heading)])
    line = Polyline(np.concatenate([back[None], driven, _onwards(scene, track, driven[-1])]))
    along = _coordinates(line, points)
    return Way(
        track,
        int(tracks.frame[rows.start]),
        line,
        along,
        _speeds(along, tracks.dt),
        float(tracks.length[track]),
        float(tracks.width[track]),
        scene.matched(track).lanelets,
        tracks.dt,
    )


def _coordinates(
    line: Polyline, points: Float64[np.ndarray, "state 2"]
) -> Float64[np.ndarray, " state"]:
    """Return coordinates of successive points, each searched near that of the one before.

    A line may cross itself or turn back beside itself.
    """
    found = np.empty(len(points))
    begin, starts = BEHIND, line.starts
    for row, point in enumerate(points):
        low = int(np.searchsorted(starts, begin - 2 * SPACING, side="right")) - 1
        high = int(np.searchsorted(starts, begin + 8.0, side="right"))
        part = Polyline(line.points[max(low, 0) : high + 1])
        there = float(part.coordinates(point[:1], point[1:]).along[0])
        begin = max(begin, starts[max(low, 0)] + max(there, 0.0))
        found[row] = begin
    return found


def _speeds(along: Float64[np.ndarray, " state"], dt: float) -> Float64[np.ndarray, " state"]:
    """Return central differences over `SMOOTHED`, one-sided at the ends; 0 for one state."""
    half = max(round(SMOOTHED / dt / 2), 1)
    frames = np.arange(len(along))
    low, high = np.maximum(frames - half, 0), np.minimum(frames + half, len(along) - 1)
    return (along[high] - along[low]) / np.maximum((high - low) * dt, dt)


def _onwards(
    scene: Scene, track: int, last: Float64[np.ndarray, 2]
) -> Float64[np.ndarray, "point 2"]:
    """Return points of the route beyond the last state, from the vehicle's offset to its middle."""
    matched, row = scene.matched(track), scene.rows(track).stop - 1
    route = scene.matcher.section(list(matched.lanelets[int(matched.place[-1]) :]), AHEAD)
    metres = np.arange(_STEP, AHEAD, _STEP)
    heading = float(scene.tracks.heading[row])
    straight = last + metres[:, None] * np.array([np.cos(heading), np.sin(heading)])
    if route is None:
        return straight
    seen = route.coordinates(last[:1], last[1:])
    if abs(seen.lateral[0]) > _ON_ROUTE:
        return straight
    ahead = float(seen.along[0]) + metres
    inside = ahead <= max(route.length, float(seen.along[0]) + _STEP)
    middle, direction = route.points_at(ahead[inside])
    offset = float(seen.lateral[0]) * np.clip(1 - metres[inside] / _RETURN, 0.0, 1.0)
    left = np.stack([-np.sin(direction), np.cos(direction)], axis=1)
    return middle + offset[:, None] * left


def frames_together(one: Way, other: Way) -> Int64[np.ndarray, " frame"]:
    """Return the frames at which both vehicles are present."""
    return np.arange(max(one.first, other.first), min(one.last, other.last) + 1)
