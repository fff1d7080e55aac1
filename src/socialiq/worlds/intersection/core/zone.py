"""Influence zone of the ego, and the neighbours that count (thesis 4.1, 5.1.3)."""

from __future__ import annotations

from typing import get_args

from socialiq.worlds.intersection.core.compile import kernel
from socialiq.worlds.intersection.core.geometry import APPROACH, EXIT
from socialiq.worlds.intersection.options import Counted, Zone

_LAST_20_M, _LAST_8_M, _BEYOND_8_M, _TRAVELLED_8_M = range(len(get_args(Zone)))
_ALL, _CROSS, _APPROACHING = range(len(get_args(Counted)))


@kernel
def in_zone(kind, along, length, travelled, settings):
    """Whether the ego is in the influence zone: the end of its approach, or the junction.

    Args:
        kind: Kind of the ego's lane: APPROACH, EXIT, or another.
        along: Coordinate along that lane, m.
        length: Length of that lane, m.
        travelled: Metres along its route since the episode began.
        settings: SETTINGS record.
    """
    if kind == EXIT:
        return False
    if kind != APPROACH:
        return True
    if settings.zone == _LAST_20_M:
        return along >= length - 20.0
    if settings.zone == _LAST_8_M:
        return along >= length - 8.0
    if settings.zone == _BEYOND_8_M:
        return along > 8.0
    return travelled > 8.0


@kernel
def counts(apart, same_origin, kind, settings):
    """Whether a neighbour is within the conflict distance and of the kind that counts.

    Args:
        apart: Distance from the ego, m.
        same_origin: Whether the neighbour entered by the ego's approach.
        kind: Kind of the neighbour's target lane: APPROACH, EXIT, or another.
        settings: SETTINGS record.
    """
    if apart > settings.conflict_distance:
        return False
    if settings.counted == _ALL:
        return True
    if same_origin or kind == EXIT:
        return False
    return settings.counted == _CROSS or kind == APPROACH
