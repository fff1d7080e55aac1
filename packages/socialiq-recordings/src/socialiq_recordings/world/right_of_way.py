"""Right of way between two vehicles whose ways meet: signs first, then turns."""

from __future__ import annotations

from socialiq_recordings.conflicts.areas import Area
from socialiq_recordings.conflicts.pairs import Encounters
from socialiq_recordings.conflicts.table import sign, turn
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.road.network import Conflict

_MINOR = ("yield", "stop")
_MAJOR = ("priority", "none", "light")
_LEFT, _STRAIGHT = 45.0, 30.0  # degrees


def yields(encounters: Encounters, one: Way, other: Way, area: Area) -> int:
    """Return 1 if the first vehicle yields, -1 if the other does, 0 if who comes first goes first.

    Args:
        encounters: Of the recording.
        one: Way of the first vehicle.
        other: Way of the other.
        area: Their conflict area, the first one's coordinates first.
    """
    signs = sign(encounters, one, other), sign(encounters, other, one)
    if signs[0] in _MINOR and signs[1] in _MAJOR:
        return 1
    if signs[1] in _MINOR and signs[0] in _MAJOR:
        return -1
    if area.kind == Conflict.CROSSING:
        turns = turn(one, area.entry[0], area.exit[0]), turn(other, area.entry[1], area.exit[1])
        left = turns[0] > _LEFT, turns[1] > _LEFT
        if left[0] != left[1] and min(abs(one) for one in turns) < _STRAIGHT:
            return 1 if left[0] else -1
    return 0
