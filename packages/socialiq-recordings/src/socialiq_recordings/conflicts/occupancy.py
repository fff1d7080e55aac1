"""Times at which a vehicle is in a conflict area: recorded, or projected at its present speed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from socialiq_recordings.conflicts.ways import Way

STANDING = 0.1
"""m/s; a slower vehicle doesn't arrive at its present speed."""


class Occupancy(NamedTuple):
    """Times of a vehicle in a conflict area, s from the recording's frame 0.

    Attributes:
        enters: Its front arrives; minus infinity if before its first frame, infinity if never.
        leaves: Its rear leaves.
    """

    enters: float
    leaves: float


def recorded(way: Way, entry: float, end: float) -> Occupancy:
    """Return the recorded times.

    Args:
        way: The vehicle's way.
        entry: Coordinate of the area's beginning, m.
        end: Coordinate of its end, m.
    """
    half = way.length / 2
    return Occupancy(way.reached(entry - half) * way.dt, way.reached(end + half) * way.dt)


def projected(way: Way, entry: float, end: float, frame: int) -> Occupancy:
    """Return the times at the speed of a frame; those that have passed are the recorded ones."""
    along, speed = way.state(frame)
    past, half, now = recorded(way, entry, end), way.length / 2, frame * way.dt
    times = []
    for before, coordinate in zip(past, (entry - half, end + half), strict=True):
        if coordinate <= along:
            times.append(before)
        else:
            times.append(now + (coordinate - along) / speed if speed >= STANDING else np.inf)
    return Occupancy(*times)


def expected(way: Way, entry: float, end: float) -> Occupancy:
    """Return the recorded times, or where a vehicle was not seen so far, those projected."""
    seen, later = recorded(way, entry, end), projected(way, entry, end, way.last)
    return Occupancy(
        *(a if np.isfinite(a) or a < 0 else b for a, b in zip(seen, later, strict=True))
    )


def apart(one: Occupancy, other: Occupancy) -> float:
    """Return the time between two occupancies, s; 0 if they overlap.

    Infinity if one never arrives, or both had left before they came into view.
    """
    if one.enters == np.inf or other.enters == np.inf:
        return float("inf")
    gaps = other.enters - one.leaves, one.enters - other.leaves
    return float("inf") if np.isnan(gaps).any() else max(*gaps, 0.0)
