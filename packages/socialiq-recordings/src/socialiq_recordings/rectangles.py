"""Overlaps of recorded vehicles: separating axes of two rectangles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial import KDTree

from socialiq_recordings.tracks import Tracks


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
    found, begin = [], 0
    while begin < len(order):
        # A block ends with a frame.
        last = frames[min(begin + _BLOCK, len(order)) - 1]
        end = int(np.searchsorted(frames, last, side="right"))
        found.append(_overlaps_of(tracks, order[begin:end]))
        begin = end
    return Overlaps(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _overlaps_of(tracks: Tracks, rows: Int64[np.ndarray, " some"]) -> Overlaps:
    half = np.stack([tracks.length, tracks.width], axis=1) / 2
    one, other = _near(tracks, rows, np.hypot(half[:, 0], half[:, 1]))
    half_one, half_other = half[tracks.track[one]], half[tracks.track[other]]
    apart = np.stack([tracks.x[other] - tracks.x[one], tracks.y[other] - tracks.y[one]], axis=1)
    turned = tracks.heading[other] - tracks.heading[one]
    cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    depth = np.full(len(one), np.inf)
    for own_half, other_half, row in ((half_one, half_other, one), (half_other, half_one, other)):
        east, north = np.cos(tracks.heading[row]), np.sin(tracks.heading[row])
        along = np.abs(apart[:, 0] * east + apart[:, 1] * north)
        across = np.abs(apart[:, 1] * east - apart[:, 0] * north)
        reach_along = own_half[:, 0] + other_half[:, 0] * cos + other_half[:, 1] * sin
        reach_across = own_half[:, 1] + other_half[:, 0] * sin + other_half[:, 1] * cos
        depth = np.minimum(depth, np.minimum(reach_along - along, reach_across - across))
    touch = depth > 0
    return Overlaps(one[touch], other[touch], depth[touch])


def _near(
    tracks: Tracks, rows: Int64[np.ndarray, " some"], radius: Float64[np.ndarray, " track"]
) -> tuple[Int64[np.ndarray, " pair"], Int64[np.ndarray, " pair"]]:
    """Return pairs of rows of a frame whose circumscribed circles meet."""
    reach = 2 * radius.max()
    # A third axis separates frames, so that states of different frames are never near.
    frames = (tracks.frame[rows] - tracks.frame[rows].min()) * (2 * reach)
    places = np.stack([tracks.x[rows], tracks.y[rows], frames], axis=1)
    pairs = rows[KDTree(places).query_pairs(reach, output_type="ndarray")]
    one, other = pairs[:, 0], pairs[:, 1]
    distance = np.hypot(tracks.x[other] - tracks.x[one], tracks.y[other] - tracks.y[one])
    meet = distance < radius[tracks.track[one]] + radius[tracks.track[other]]
    return one[meet], other[meet]
