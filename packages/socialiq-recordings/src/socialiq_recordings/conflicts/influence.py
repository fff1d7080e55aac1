"""Influence with a reason: the ego was in the other's way, moved first, and made a difference."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool

from socialiq_recordings.conflicts.around import leader, on_way
from socialiq_recordings.conflicts.counterfactual import rollout
from socialiq_recordings.conflicts.occupancy import projected, recorded
from socialiq_recordings.conflicts.pairs import Encounters
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.episodes.annotate import Prepared
from socialiq_recordings.episodes.charged import charged

Relation = Literal["crossing", "merging", "leads", "none"]

RULES = ("in the way", "moved first", "speed held", "absent")
"""Rules beside Eq 4.2, each with those before it; the last two are alternatives."""


class Reason(NamedTuple):
    """Reason for which a vehicle's braking may be the ego's doing.

    Attributes:
        relation: Their ways cross or merge, or the ego leads the other in its lane.
        first: Whether the ego moved first.
        lost_to_change: m/s that the other loses by the model because the ego did not hold its
            speed; 0 without a relation.
        lost_to_presence: The same because the ego was there.
    """

    relation: Relation
    first: bool
    lost_to_change: float
    lost_to_presence: float

    def rules(self, changed: float) -> tuple[bool, bool, bool, bool]:
        """Return which of `RULES` hold.

        Args:
            changed: m/s; the smallest loss that counts.
        """
        related = self.relation != "none"
        moved = related and self.first
        held = moved and self.lost_to_change >= changed
        return related, moved, held, moved and self.lost_to_presence >= changed


UNRELATED = Reason("none", False, 0.0, 0.0)


def reason(encounters: Encounters, ego: int, other: int, frames: tuple[int, int]) -> Reason:
    """Return the reason for which the ego may have made another vehicle brake.

    Args:
        encounters: Of the recording.
        ego: Track of the ego.
        other: Track of the vehicle that braked.
        frames: First and last frame of the braking.
    """
    ways = encounters.ways
    if ego not in ways or other not in ways:
        return UNRELATED
    begin = max(frames[0], ways[ego].first, ways[other].first)
    last = min(frames[1], ways[other].last)
    if begin >= last or begin > ways[ego].last:
        return UNRELATED
    related = relation(encounters, ego, other, begin)
    if related == "none" or encounters.held(ways[ego], ways[other], begin):
        return UNRELATED  # what a red light makes a vehicle do is no vehicle's doing
    back = round(encounters.config.lookback / ways[ego].dt)
    start = max(begin - back, ways[ego].first, ways[other].first)
    span = (start, last)
    if related == "leads":
        first = slowed_first(ways[ego], ways[other], span, encounters.config.slowed)
    else:
        first = enters_first(encounters, ego, other, begin)
    seen = rollout(encounters, ego, other, span, "recorded").speed
    held, absent = (
        rollout(encounters, ego, other, span, mode).speed for mode in ("holds", "absent")
    )
    return Reason(related, first, held - seen, absent - seen)


def relation(encounters: Encounters, ego: int, other: int, frame: int) -> Relation:
    """Return how the ego is in another vehicle's way at a frame.

    Ways conflict until the ego has left the area, and while the other has not entered it.

    Args:
        encounters: Of the recording.
        ego: Track of the ego.
        other: Track of the other vehicle.
        frame: A frame at which both are present.
    """
    area = encounters.area(ego, other)
    own, theirs = encounters.ways[ego], encounters.ways[other]
    now = frame * own.dt
    if area is not None:
        leaves = recorded(own, area.entry[0], area.exit[0]).leaves
        enters = recorded(theirs, area.entry[1], area.exit[1]).enters
        if leaves > now and enters > now:
            return "crossing" if area.kind.name == "CROSSING" else "merging"
    along, _ = theirs.state(frame)
    others = on_way(encounters.scene, theirs, frame, encounters.config.slack)
    return "leads" if leader(theirs, along, others).track == ego else "none"


def enters_first(encounters: Encounters, ego: int, other: int, frame: int) -> bool:
    """Whether the ego enters the conflict area of two ways first, and moves.

    By recorded times where one of them entered, else by those projected at a frame.

    Args:
        encounters: Of the recording.
        ego: Track of the ego.
        other: Track of the other vehicle.
        frame: A frame at which both are present.
    """
    area = encounters.area(ego, other)
    if area is None:
        return False
    sides = zip((encounters.ways[ego], encounters.ways[other]), area.entry, area.exit, strict=True)
    each = list(sides)
    times = [recorded(*side).enters for side in each]
    if np.isinf(times).all():
        times = [projected(*side, frame).enters for side in each]
    return bool(times[0] < times[1])


def slowed_first(ego: Way, other: Way, frames: tuple[int, int], slowed: float) -> bool:
    """Whether the ego lost speed, and no later than the other.

    Args:
        ego: Way of the leader.
        other: Way of the follower.
        frames: First and last frame.
        slowed: m/s below the highest speed so far that count as a loss.
    """
    falls = [_first_fall(way, frames, slowed) for way in (ego, other)]
    return falls[0] is not None and (falls[1] is None or falls[0] <= falls[1])


def _first_fall(way: Way, frames: tuple[int, int], slowed: float) -> int | None:
    first, last = max(frames[0], way.first), min(frames[1], way.last)
    speed = way.speed[first - way.first : last + 1 - way.first]
    fallen = np.flatnonzero(np.maximum.accumulate(speed) - speed >= slowed)
    return first + int(fallen[0]) if len(fallen) else None


def unreasoned(encounters: Encounters, track: int, ready: Prepared) -> Bool[np.ndarray, "row slot"]:
    """Return which charged losses of speed have no reason: absent, the ego changes nothing.

    Args:
        encounters: Of the recording.
        track: The ego.
        ready: Records of its episode.
    """
    found = np.zeros(ready.seen.shape, bool)
    for one in charged(encounters.scene, ready):
        why = reason(encounters, track, one.track, one.frames)
        kept = why.rules(encounters.config.changed)[RULES.index("absent")]
        found[one.snapshot, one.slot] = not kept
    return found
