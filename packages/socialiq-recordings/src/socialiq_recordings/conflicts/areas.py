"""Conflict areas: where the ways of two vehicles cross or merge.

The swept area of a way is what the vehicle's width covers along it. Shapely (extra `maps`)
intersects two of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.road.network import Conflict, Lanes, shapely
from socialiq_recordings.road.paths import Polyline, wrapped

SAME_WAY = np.radians(20.0)
"""Ways whose directions differ by less at the end of their common area go on together."""

_LEAST = 0.1  # m²; smaller areas are errors of the lines
_SEPARATE = 2.5  # m; vehicles that merge came from further beside each other than this
_JOINED = 1.0  # m; and get closer than this
_BEFORE = 50.0  # m before a merging line in which they were apart
_START = 1.0  # m after a line's start within which an area begins there


@dataclass(frozen=True, eq=False)
class Area:
    """Conflict area of two ways.

    Attributes:
        kind: Crossing or merging.
        entry: Coordinate at which each vehicle's swept area begins to be in it, m.
        exit: Coordinate at which it ends; the entry where the ways merge, because from this line
            on one vehicle follows the other.
        angle: Difference of the directions in it, degrees in [0, 180].
        x: Its middle, m to the east.
        y: Its middle, m to the north.
        outline: Its corners, m.
    """

    kind: Conflict
    entry: tuple[float, float]
    exit: tuple[float, float]
    angle: float
    x: float
    y: float
    outline: Float64[np.ndarray, "corner 2"]

    def swapped(self) -> Area:
        """Return the area with the vehicles in the other order."""
        return Area(
            self.kind,
            (self.entry[1], self.entry[0]),
            (self.exit[1], self.exit[0]),
            self.angle,
            self.x,
            self.y,
            self.outline,
        )


def swept(way: Way, slack: float) -> Any:
    """Return the swept area of a way, for Shapely.

    Args:
        way: The way.
        slack: m by which the vehicle is narrower than recorded.
    """
    line = shapely().linestrings(way.line.points)
    return line.buffer(max(way.width - slack, 0.1) / 2, cap_style="flat", join_style="round")


def area_of(one: Way, other: Way, one_swept: Any, other_swept: Any, lanes: Lanes) -> Area | None:
    """Return the first area in which two ways cross or merge; None if there is none.

    The map must agree: two lanelets of the routes are in conflict, or both routes enter one
    lanelet from different lanelets, as in a change of lane. An area that begins where one of the
    lines does is no conflict: the vehicles follow each other, or the first is past it.

    Args:
        one: A way.
        other: Another.
        one_swept: Swept area of the first.
        other_swept: Swept area of the second.
        lanes: Road with conflicts.
    """
    if not one_swept.intersects(other_swept) or not _routes_meet(one, other, lanes):
        return None
    common = one_swept.intersection(other_swept)
    found = []
    for part in getattr(common, "geoms", [common]):
        if part.geom_type == "Polygon" and part.area >= _LEAST:
            area = _area(one, other, part)
            if area is not None:
                found.append(area)
    return min(found, key=lambda area: area.entry[0]) if found else None


def _area(one: Way, other: Way, part: Any) -> Area | None:
    corners = np.array(part.exterior.coords)[:-1]
    ranges = [_range(way.line, corners) for way in (one, other)]
    if any(low <= _START for low, _ in ranges):
        return None
    entry, end = (ranges[0][0], ranges[1][0]), (ranges[0][1], ranges[1][1])
    middle = (entry[0] + end[0]) / 2, (entry[1] + end[1]) / 2
    merging = _between(one.line, end[0], other.line, end[1]) < SAME_WAY
    if merging and not _merge(one, other, entry, end[0]):
        return None
    # Ways that join are compared where they meet, ways that cross in the middle.
    at = entry if merging else middle
    return Area(
        Conflict.MERGING if merging else Conflict.CROSSING,
        entry,
        entry if merging else end,
        float(np.degrees(_between(one.line, at[0], other.line, at[1]))),
        float(part.centroid.x),
        float(part.centroid.y),
        corners,
    )


def _merge(one: Way, other: Way, entry: tuple[float, float], end: float) -> bool:
    """Whether vehicles whose swept areas join come from different lanes to one.

    Neither has passed the line where their ways join at its first state. Ways side by side, and
    those of vehicles in one lane, touch by errors of positions.
    """
    starts = zip((one, other), entry, strict=True)
    if any(way.along[0] + way.length / 2 > at for way, at in starts):
        return False
    before = _beside(one.line, other.line, max(entry[0] - _BEFORE, 0.0), entry[0])
    after = _beside(one.line, other.line, entry[0], end)
    return bool(before.max() >= _SEPARATE and after.min() < _JOINED)


def _beside(
    line: Polyline, other: Polyline, low: float, high: float
) -> Float64[np.ndarray, " point"]:
    """Return distances between two lines along a part of the first, m."""
    points = line.points_at(np.append(np.arange(low, high, 1.0), high))[0]
    return np.abs(other.coordinates(points[:, 0], points[:, 1]).lateral)


def _range(line: Polyline, corners: Float64[np.ndarray, "corner 2"]) -> tuple[float, float]:
    along = line.coordinates(corners[:, 0], corners[:, 1]).along
    return float(along.min()), float(min(along.max(), line.length))


def _between(one: Polyline, at: float, other: Polyline, other_at: float) -> float:
    headings = [
        line.points_at(np.array([coordinate]))[1]
        for line, coordinate in ((one, at), (other, other_at))
    ]
    return float(abs(wrapped(headings[0] - headings[1]))[0])


def _routes_meet(one: Way, other: Way, lanes: Lanes) -> bool:
    if any(lanes.conflict(a, b) for a in one.lanelets for b in other.lanelets):
        return True
    before = [dict(zip(way.lanelets[1:], way.lanelets, strict=False)) for way in (one, other)]
    shared = set(one.lanelets) & set(other.lanelets)
    return any(before[0].get(number) != before[1].get(number) for number in shared)
