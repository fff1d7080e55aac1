"""Decisions of a recorded driver: acceleration, and steering towards a lane path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int32, Int64

from socialiq_recordings.episodes.scene import Scene

MOVING = 0.5
"""m/s; a slower vehicle has no curvature and its direction is noise."""


class Decisions(NamedTuple):
    """Decisions of a vehicle, and what constant accelerations and curvatures leave unexplained.

    Attributes:
        acceleration: Change of speed over the decision by its duration, m/s².
        curvature: Change of heading by the distance driven, 1/m, positive to the left; 0 for a
            vehicle slower than `MOVING`.
        lanelet: Number of the lanelet that the vehicle is on at the end: the lane path that it
            steers towards.
        lateral: Distance to the left of that path at the decision, m.
        lateral_after: The same at its end.
        ahead: Recorded position at the end minus that of constant acceleration and curvature,
            along the heading at the decision, m.
        beside: The same to the left.
    """

    acceleration: Float64[np.ndarray, " decision"]
    curvature: Float64[np.ndarray, " decision"]
    lanelet: Int64[np.ndarray, " decision"]
    lateral: Float64[np.ndarray, " decision"]
    lateral_after: Float64[np.ndarray, " decision"]
    ahead: Float64[np.ndarray, " decision"]
    beside: Float64[np.ndarray, " decision"]


def decisions_at(scene: Scene, rows: Int64[np.ndarray, " decision_and_one"]) -> Decisions:
    """Return a vehicle's decisions between some of its rows.

    Args:
        scene: The recording.
        rows: Rows of one track at every decision, and at the end of the last one.
    """
    tracks, speed = scene.tracks, scene.speed[rows]
    now, then = rows[:-1], rows[1:]
    seconds = (then - now) * tracks.dt
    acceleration = np.diff(speed) / seconds
    turned = wrapped_difference(tracks.heading[now], tracks.heading[then])
    driven = np.array([_driven(scene, int(a), int(b)) for a, b in zip(now, then, strict=True)])
    slow = np.minimum(driven / seconds, np.maximum(speed[:-1], speed[1:])) < MOVING
    curvature = np.where(slow, 0.0, turned / np.where(slow, 1.0, driven))
    ahead, beside = displacement(speed[:-1], acceleration, curvature, seconds)
    dx, dy = tracks.x[then] - tracks.x[now], tracks.y[then] - tracks.y[now]
    cos, sin = np.cos(tracks.heading[now]), np.sin(tracks.heading[now])
    lanelet = _lanelets(scene, then)
    return Decisions(
        acceleration,
        curvature,
        lanelet,
        _lateral(scene, now, lanelet),
        _lateral(scene, then, lanelet),
        dx * cos + dy * sin - ahead,
        dy * cos - dx * sin - beside,
    )


def displacement(
    speed: Float64[np.ndarray, " decision"],
    acceleration: Float64[np.ndarray, " decision"],
    curvature: Float64[np.ndarray, " decision"],
    seconds: Float64[np.ndarray, " decision"],
) -> tuple[Float64[np.ndarray, " decision"], Float64[np.ndarray, " decision"]]:
    """Return the displacement under constant acceleration and curvature.

    The path is an arc. A vehicle that comes to a stand stays there.

    Args:
        speed: m/s at the start.
        acceleration: m/s².
        curvature: 1/m, positive to the left.
        seconds: Duration.

    Returns:
        Metres along the heading at the start, and to its left.
    """
    braking = np.where(acceleration < 0, -acceleration, 1.0)
    until = np.where(acceleration < 0, np.minimum(seconds, speed / braking), seconds)
    metres = speed * until + acceleration * until**2 / 2
    angle = curvature * metres
    # sin(a)/a and (1 - cos(a))/a, also at 0.
    return metres * np.sinc(angle / np.pi), metres * np.sinc(angle / (2 * np.pi)) ** 2 * angle / 2


def wrapped_difference(
    before: Float64[np.ndarray, " decision"], after: Float64[np.ndarray, " decision"]
) -> Float64[np.ndarray, " decision"]:
    """Return after minus before as an angle in [-π, π)."""
    return (after - before + np.pi) % (2 * np.pi) - np.pi


class Levels(NamedTuple):
    """Decisions as levels of acceleration.

    Attributes:
        action: Index of the closest level; of two equally close, the one nearer to 0.
        residual: Speed at the next decision minus that of the level, m/s.
    """

    action: Int32[np.ndarray, " decision"]
    residual: Float64[np.ndarray, " decision"]


def levels_of(
    speed: Float64[np.ndarray, " decision_and_one"], levels: Sequence[float], seconds: float
) -> Levels:
    """Return the closest level of acceleration of each decision.

    Args:
        speed: Speed at every decision, and at the end of the last one, m/s.
        levels: m/s², ascending.
        seconds: Duration of a decision.
    """
    values = np.asarray(levels, np.float64)
    changes = np.diff(speed)
    misses = changes[:, None] - values * seconds
    # A tie goes to the level nearer to 0.
    action = np.argmin(np.round(np.abs(misses), 9) + 1e-12 * np.abs(values), axis=1)
    return Levels(action.astype(np.int32), misses[np.arange(len(changes)), action])


def _driven(scene: Scene, first: int, last: int) -> float:
    x, y = scene.tracks.x[first : last + 1], scene.tracks.y[first : last + 1]
    return float(np.hypot(np.diff(x), np.diff(y)).sum())


def _lanelets(scene: Scene, rows: Int64[np.ndarray, " decision"]) -> Int64[np.ndarray, " decision"]:
    if not len(rows):
        return np.zeros(0, np.int64)
    track = int(scene.tracks.track[rows[0]])
    matched, first = scene.matched(track), scene.rows(track).start
    return np.array(matched.lanelets, np.int64)[matched.place[rows - first]]


def _lateral(
    scene: Scene,
    rows: Int64[np.ndarray, " decision"],
    lanelet: Int64[np.ndarray, " decision"],
) -> Float64[np.ndarray, " decision"]:
    found = np.zeros(len(rows))
    for number in np.unique(lanelet).tolist():
        here = lanelet == number
        x, y = scene.tracks.x[rows[here]], scene.tracks.y[rows[here]]
        found[here] = scene.matcher.path(number).coordinates(x, y).lateral
    return found
