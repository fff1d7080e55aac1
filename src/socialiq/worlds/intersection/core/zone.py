"""Where the ego influences others, and which of them count (thesis 4.1, 5.1.3)."""

from __future__ import annotations

from typing import get_args

from socialiq.worlds.intersection.core.compile import kernel
from socialiq.worlds.intersection.core.ego import route_coordinate
from socialiq.worlds.intersection.core.geometry import APPROACH, EXIT, LANES, distance, longitudinal
from socialiq.worlds.intersection.options import Counted, Zone

_LAST_20_M, _LAST_8_M, _BEYOND_8_M, _TRAVELLED_8_M = range(len(get_args(Zone)))
_ALL, _CROSS, _APPROACHING = range(len(get_args(Counted)))


@kernel
def in_zone(ego, start, settings):
    """Whether the ego is in the influence zone: the end of its approach, or the junction.

    Args:
        ego: VEHICLE record after the decision.
        start: Route coordinate at which the episode began, m.
        settings: SETTINGS record.
    """
    kind = ego.lane % 5
    if kind == EXIT:
        return False
    if kind != APPROACH:
        return True
    lane = LANES[ego.lane]
    along = longitudinal(lane, ego.x, ego.y)
    if settings.zone == _LAST_20_M:
        return along >= lane.length - 20.0
    if settings.zone == _LAST_8_M:
        return along >= lane.length - 8.0
    if settings.zone == _BEYOND_8_M:
        return along > 8.0
    return route_coordinate(ego) - start > 8.0


@kernel
def counts(other, ego, settings):
    """Whether a neighbour is within the conflict distance and of the kind that counts."""
    if distance(other.x, other.y, ego.x, ego.y) > settings.conflict_distance:
        return False
    if settings.counted == _ALL:
        return True
    kind = other.target_lane % 5
    if other.origin == ego.origin or kind == EXIT:
        return False
    return settings.counted == _CROSS or kind == APPROACH
