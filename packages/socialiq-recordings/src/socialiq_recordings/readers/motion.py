"""Velocities and headings derived from positions and lanes, for files without them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.signal import savgol_filter
from scipy.spatial import KDTree

from socialiq_recordings.road.network import RoadNetwork, lanelet_points

STILL = 0.5
"""m/s; slower than this, the direction of a smoothed displacement is noise and the last direction
at speed is kept."""

WINDOW = 1.1
"""s over which positions are smoothed by a quadratic before they are differenced."""

_MOVING = 1.0  # m/s
_LANE = 2.5  # m; a standing vehicle is in a lane whose middle is this close
_PASSED = 1.0  # m; or stands where another passed

Column = Float64[np.ndarray, " state"]


def wrapped(angle: Column) -> Column:
    """Return the same direction in (-π, π]; an angle in this range keeps its bits."""
    outside = (angle <= -np.pi) | (angle > np.pi)
    return np.where(outside, np.pi - np.mod(np.pi - angle, 2 * np.pi), angle)


def differences(x: Column, y: Column, dt: float) -> tuple[Column, Column]:
    """Return a track's velocity by central differences, one-sided at its ends; 0 for one state."""
    if len(x) < 2:
        return np.zeros(len(x)), np.zeros(len(x))
    return np.gradient(x, dt), np.gradient(y, dt)


def smoothed(x: Column, y: Column, dt: float) -> tuple[Column, Column]:
    """Return a track's velocity, m/s, by a local quadratic (Savitzky and Golay 1964).

    The number of frames is odd and fits `WINDOW` and the track; a track of fewer than
    three states is differenced.
    """
    window = min(2 * round(WINDOW / dt / 2) + 1, len(x) - (len(x) + 1) % 2)
    if window < 3:
        return differences(x, y, dt)
    vx, vy = (
        np.asarray(savgol_filter(positions, window, 2, deriv=1, delta=dt, mode="interp"))
        for positions in (x, y)
    )
    return vx, vy


def heading_of_motion(vx: Column, vy: Column) -> Column | None:
    """Return the direction of travel; below `STILL`, that of the last faster state.

    Before a track first moves, it is its first direction of travel.

    Returns:
        rad in (-π, π], or None if the track never moves.
    """
    moving = np.flatnonzero(np.hypot(vx, vy) >= STILL)
    if not len(moving):
        return None
    last = np.maximum(np.searchsorted(moving, np.arange(len(vx)), side="right") - 1, 0)
    return np.arctan2(vy, vx)[moving[last]]


class Directions:
    """Directions of lanes, or of the vehicles that moved, by place."""

    def __init__(self, road: RoadNetwork, states: list[np.ndarray]) -> None:
        lines = [lanelet_points(lanelet) for lanelet in road.lanelets.values()]
        moving = [rows[:3, np.hypot(rows[3], rows[4]) >= _MOVING].T for rows in states]
        self._points, self._reach = (lines, _LANE) if lines else (moving, _PASSED)
        self._all = np.concatenate([np.zeros((0, 3)), *self._points])
        self._tree = KDTree(self._all[:, :2]) if len(self._all) else None

    def at(self, x: float, y: float) -> float | None:
        """Return the direction at a place, rad; None if nothing is near."""
        if self._tree is None or not np.isfinite([x, y]).all():
            return None
        distance, nearest = self._tree.query([x, y])
        return float(self._all[nearest, 2]) if distance <= self._reach else None
