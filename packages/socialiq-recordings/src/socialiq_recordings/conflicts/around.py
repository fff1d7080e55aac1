"""Vehicles on another's way: its leaders and followers, frame by frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.road.paths import wrapped
from socialiq_recordings.road.routes import Scene

_SAME_DIRECTION = np.radians(45.0)
_REACH = 100.0  # m; vehicles further ahead are no leaders


class Near(NamedTuple):
    """Neighbour of a vehicle on its way.

    Attributes:
        track: Number of the track; -1 if there is none.
        gap: Between the bumpers, m; infinite if there is none.
        speed: Of the neighbour along the way, m/s; 0 if there is none.
    """

    track: int
    gap: float
    speed: float


NONE = Near(-1, float("inf"), 0.0)


class OnWay(NamedTuple):
    """Other vehicles of one frame that are on a way.

    Attributes:
        track: Numbers of the tracks.
        along: Coordinates of their middles on the way, m.
        speed: Along the way, m/s.
        length: m.
    """

    track: Int64[np.ndarray, " vehicle"]
    along: Float64[np.ndarray, " vehicle"]
    speed: Float64[np.ndarray, " vehicle"]
    length: Float64[np.ndarray, " vehicle"]

    def without(self, track: int) -> OnWay:
        """Return the others."""
        return OnWay(*(column[self.track != track] for column in self))


def on_way(scene: Scene, way: Way, frame: int, slack: float) -> OnWay:
    """Return the vehicles whose rectangles are on a way at a frame, driving as it leads.

    Args:
        scene: The recording.
        way: The way.
        frame: The frame.
        slack: m by which vehicles are narrower than recorded.
    """
    tracks = scene.tracks
    rows = scene.present(frame)
    rows = rows[tracks.track[rows] != way.track]
    seen = way.line.coordinates(tracks.x[rows], tracks.y[rows])
    turned = wrapped(tracks.heading[rows] - seen.heading)
    number = tracks.track[rows]
    inside = in_the_way(way, seen.lateral, turned, tracks.width[number], slack)
    speed = scene.speed[rows] * np.cos(turned)
    chosen = number[inside].astype(np.int64)
    return OnWay(chosen, seen.along[inside], speed[inside], tracks.length[chosen])


def in_the_way(
    way: Way,
    lateral: Float64[np.ndarray, " vehicle"],
    turned: Float64[np.ndarray, " vehicle"],
    width: Float64[np.ndarray, " vehicle"],
    slack: float,
) -> Bool[np.ndarray, " vehicle"]:
    """Whether vehicles beside a way overlap what it sweeps, and drive as it leads.

    Args:
        way: The way.
        lateral: Distance of their middles from it, m.
        turned: Their headings relative to it, rad.
        width: m.
        slack: m by which all are narrower than recorded.
    """
    beside = np.abs(lateral) < (way.width + width) / 2 - slack
    return beside & (np.abs(turned) < _SAME_DIRECTION)


def leader(way: Way, along: float, others: OnWay) -> Near:
    """Return the next vehicle ahead of a coordinate.

    Args:
        way: The follower's way.
        along: Coordinate of its middle, m.
        others: Vehicles on its way.
    """
    ahead = (others.along > along) & (others.along < along + _REACH)
    if not ahead.any():
        return NONE
    place = int(np.argmin(np.where(ahead, others.along, np.inf)))
    gap = others.along[place] - along - (others.length[place] + way.length) / 2
    return Near(int(others.track[place]), float(gap), float(others.speed[place]))


def follower(way: Way, along: float, others: OnWay) -> Near:
    """Return the next vehicle behind a coordinate, as `leader` does ahead."""
    behind = (others.along < along) & (others.along > along - _REACH)
    if not behind.any():
        return NONE
    place = int(np.argmax(np.where(behind, others.along, -np.inf)))
    gap = along - others.along[place] - (others.length[place] + way.length) / 2
    return Near(int(others.track[place]), float(gap), float(others.speed[place]))
