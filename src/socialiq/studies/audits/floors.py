"""Safety floors by angle."""

from __future__ import annotations

from socialiq.audit.profile.profile import Floor
from socialiq.audit.profile.template import FLOOR

WITHDRAWN = Floor(FLOOR.max_at_fault, FLOOR.max_struck, min_arrival=0.0, max_timeout=1.0)
"""Omit arrivals where only the others count, since the best driver never arrives there."""

_NEARLY_90 = 75.0  # degrees


def floor_at(angle: float) -> Floor:
    """Return the default floor; beyond 75 degrees arrivals are not required."""
    return WITHDRAWN if angle > _NEARLY_90 else FLOOR
