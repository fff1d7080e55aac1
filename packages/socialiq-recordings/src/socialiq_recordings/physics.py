"""Physics of vehicles over arrays: angles, car-following, constant acceleration, rectangles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial import KDTree

if TYPE_CHECKING:
    from socialiq_recordings.recording import Tracks


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Return the same angles in [-π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def wrapped_heading(angle: np.ndarray) -> np.ndarray:
    """Return the same directions in (-π, π]; an angle in this range keeps its bits."""
    outside = (angle <= -np.pi) | (angle > np.pi)
    return np.where(outside, np.pi - np.mod(np.pi - angle, 2 * np.pi), angle)


class Idm(NamedTuple):
    """IDM parameters; by default of Treiber and Kesting (2013, table 11.2), in cities."""

    desired_speed: float = 15.0  # v0, m/s
    time_headway: float = 1.0  # T, s
    jam_distance: float = 2.0  # s0, m, bumper to bumper
    max_acceleration: float = 1.0  # a, m/s²
    comfort_deceleration: float = 1.5  # b, m/s², positive


EXPONENT = 4.0  # δ
HARDEST = 8.0  # m/s²; no deceleration is harder


def acceleration(
    speed: Any,
    gap: Any,
    leader_speed: Any,
    desired: Any,
    headway: Any,
    jam: Any,
    strongest: Any,
    comfort: Any,
) -> Any:
    """Return the acceleration of the IDM, m/s² (Treiber, Hennecke and Helbing 2000, eqs 3, 4).

    a (1 - (v/v0)^δ - (s*/s)²) with s* = s0 + max(0, v T + v (v - v_l) / (2 sqrt(a b))). Numbers or
    arrays that fit each other: v, the gap s to the leader's rear, infinite without a leader, its
    speed v_l, and the fields of `Idm`. `world.traffic.idm` is the compiled form.
    """
    closing = speed * (speed - leader_speed) / (2 * np.sqrt(strongest * comfort))
    keeps = jam + np.maximum(0.0, speed * headway + closing)
    free = 1 - (speed / desired) ** EXPONENT
    rate = strongest * (free - (keeps / np.maximum(gap, 0.1)) ** 2)
    return np.maximum(rate, -HARDEST)


def ballistic(
    speed: Float64[np.ndarray, "*shape"], rate: Float64[np.ndarray, "*shape"], seconds: float
) -> tuple[Float64[np.ndarray, "*shape"], Float64[np.ndarray, "*shape"]]:
    """Return the distances driven, m, and the speeds after a step of constant acceleration, m/s.

    The ballistic update of Treiber and Kesting (2013); a vehicle that comes to a stand stays.
    """
    after = speed + rate * seconds
    stops = after < 0
    until_stand = speed**2 / (-2 * np.where(stops, rate, -1.0))
    driven = np.where(stops, until_stand, (speed + after) / 2 * seconds)
    return driven, np.maximum(after, 0.0)


class Overlaps(NamedTuple):
    """Pairs of rows of a frame whose rectangles overlap, and the depth, m.

    The depth is the smallest displacement that would separate the rectangles.
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


def _overlaps_of(tracks: Tracks, rows: Int64[np.ndarray, " row"]) -> Overlaps:
    half = np.stack([tracks.length, tracks.width], axis=1) / 2
    radius = np.hypot(half[:, 0], half[:, 1])
    reach = 2 * radius.max()
    # A third axis separates frames, so that states of different frames are never near.
    frames = (tracks.frame[rows] - tracks.frame[rows].min()) * (2 * reach)
    points = np.stack([tracks.x[rows], tracks.y[rows], frames], axis=1)
    first, second = rows[KDTree(points).query_pairs(reach, output_type="ndarray")].T
    distance = np.hypot(tracks.x[second] - tracks.x[first], tracks.y[second] - tracks.y[first])
    near = distance < radius[tracks.track[first]] + radius[tracks.track[second]]
    first, second = first[near], second[near]
    apart_x, apart_y = tracks.x[second] - tracks.x[first], tracks.y[second] - tracks.y[first]
    turned = tracks.heading[second] - tracks.heading[first]
    cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    depth = np.full(len(first), np.inf)
    for row, beside in ((first, second), (second, first)):
        length, width = half[tracks.track[row]].T
        other_length, other_width = half[tracks.track[beside]].T
        east, north = np.cos(tracks.heading[row]), np.sin(tracks.heading[row])
        along = np.abs(apart_x * east + apart_y * north)
        across = np.abs(apart_y * east - apart_x * north)
        reach_along = length + other_length * cos + other_width * sin
        reach_across = width + other_length * sin + other_width * cos
        depth = np.minimum(depth, np.minimum(reach_along - along, reach_across - across))
    touch = depth > 0
    return Overlaps(first[touch], second[touch], depth[touch])
