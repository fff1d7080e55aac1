"""The reward pair of thesis 4.1: named signals of two consecutive snapshots, weighted and summed.

A snapshot is the vehicles at a decision (before) or when its sub-steps are over (after), before
anyone is cleared or spawned. Nobody comes or goes in between, so a vehicle has the same slot in
both.
"""

from __future__ import annotations

from typing import get_args

from socialiq.types import Ending
from socialiq.worlds.intersection.core.compile import kernel
from socialiq.worlds.intersection.core.ego import arrived, route_coordinate
from socialiq.worlds.intersection.core.geometry import LANES, distance, on_lane
from socialiq.worlds.intersection.core.traffic import clip
from socialiq.worlds.intersection.core.zone import counts, in_zone
from socialiq.worlds.intersection.options import Crash, Disruption
from socialiq.worlds.intersection.settings import ENV_SIGNALS, SIGNALS

_N_ENV, _N_SIGNALS = len(ENV_SIGNALS), len(SIGNALS)
_DEAD_ZONE, _LITERAL = range(len(get_args(Disruption)))
_OVERRIDE, _ADD = range(len(get_args(Crash)))
(
    _PROGRESS,
    _SPEED,
    _STEP,
    _COLLISION,
    _ARRIVAL,
    _TIMEOUT,
    _YIELDING,
    _DISRUPTION,
    _NEIGHBOUR_COLLISION,
) = range(len(SIGNALS))
_NO_ENDING, _ARRIVED, _COLLIDED, _TIMED_OUT = (
    int(kind) for kind in (Ending.NONE, Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT)
)


@kernel
def ending_of(ego, out_of_time):
    """How the episode ends with this snapshot; a collision comes before an arrival."""
    if ego.crashed:
        return _COLLIDED
    if arrived(ego):
        return _ARRIVED
    return _TIMED_OUT if out_of_time else _NO_ENDING


@kernel
def env_signals(before, after, ending, settings, signals):
    """Write the signals of r_env (Eq 4.1).

    Collision and arrival replace what was earned on the way; a timeout comes on top of it.

    Args:
        before: The ego's VEHICLE record at the decision.
        after: The same when the sub-steps are over.
        ending: Value of `Ending`.
        settings: SETTINGS record.
        signals: All signals in the order of `SIGNALS`, overwritten up to `TIMEOUT`.
    """
    signals[:_N_ENV] = 0.0
    if ending == _COLLIDED:
        signals[_COLLISION] = 1.0
        return
    if ending == _ARRIVED:
        signals[_ARRIVAL] = 1.0
        return
    if on_lane(LANES[after.lane], after.x, after.y, 0.0):
        advance = route_coordinate(after) - route_coordinate(before)
        signals[_PROGRESS] = advance / settings.progress_unit
        signals[_SPEED] = clip(after.speed / settings.max_speed, 0.0, 1.0)
    signals[_STEP] = 1.0
    signals[_TIMEOUT] = 1.0 if ending == _TIMED_OUT else 0.0


@kernel
def social_signals(before, after, count, ego, start, ending, settings, signals, braking):
    """Write the signals of r_social (Eq 4.2), 0 outside the influence zone.

    Args:
        before: VEHICLE records at the decision.
        after: The same vehicles, in the same slots, when the sub-steps are over.
        count: How many there are.
        ego: The ego's slot.
        start: Route coordinate at which the ego began, m.
        ending: Value of `Ending`.
        settings: SETTINGS record.
        signals: All signals in the order of `SIGNALS`, overwritten from `YIELDING` on.
        braking: By slot, whether the loss of speed was charged to the ego; overwritten.
    """
    braking[:] = False
    signals[_N_ENV:] = 0.0
    if ending == _COLLIDED:
        signals[_NEIGHBOUR_COLLISION] = 1.0
        if settings.crash == _OVERRIDE:
            return
    if not in_zone(after[ego], start, settings):
        return
    neighbours = 0
    for slot in range(count):
        if slot != ego and counts(after[slot], after[ego], settings):
            neighbours += 1
            share = disruption(before[slot].speed - after[slot].speed, settings)
            signals[_DISRUPTION] += share
            braking[slot] = share > 0
    signals[_YIELDING] = yielding(after[ego].speed, neighbours, settings)


@kernel
def yielding(speed, neighbours, settings):
    """First term of Eq 4.2: (1 - v_ratio) n."""
    return (1.0 - clip(speed / settings.max_speed, 0.0, 1.0)) * neighbours


@kernel
def disruption(lost, settings):
    """A neighbour's share in the second term of Eq 4.2.

    Args:
        lost: Its loss of speed between two decisions, m/s.
        settings: SETTINGS record.
    """
    if settings.disruption == _LITERAL:
        lost = max(lost, settings.speed_threshold)
    elif lost <= settings.speed_threshold:
        return 0.0
    return min(lost / settings.speed_cap, 1.0)


@kernel
def pair(signals, settings):
    """The reward pair: r_env and r_social, each the weighted sum of its signals."""
    r_env, r_social = 0.0, 0.0
    for number in range(_N_ENV):
        r_env += settings.weights[number] * signals[number]
    for number in range(_N_ENV, _N_SIGNALS):
        r_social += settings.weights[number] * signals[number]
    return r_env, r_social


@kernel
def classical(before, after, count, ego, settings):
    """The classical formulation (thesis A.1): the ego's own reward and its neighbours' mean.

    Everybody is paid by Eq 4.1 without arrival and timeout, a fresh collision replacing the step.
    """
    own, others = 0.0, 0.0
    for slot in range(count):
        paid = _paid(before[slot], after[slot], settings)
        if slot == ego:
            own = paid
        else:
            others += paid
    return own, others / max(count - 1, 1)


@kernel
def _paid(before, after, settings):
    weights = settings.weights
    if after.crashed and not before.crashed:
        return weights[_COLLISION]
    earned = 0.0
    if on_lane(LANES[after.lane], after.x, after.y, 0.0):
        advance = distance(after.x, after.y, before.x, before.y)
        ratio = clip(after.speed / settings.max_speed, 0.0, 1.0)
        earned = weights[_PROGRESS] * advance / settings.progress_unit + weights[_SPEED] * ratio
    return earned + weights[_STEP]


@kernel
def neighbours_collided(before, after, count, ego, touched):
    """How many vehicles crashed since the decision, without the ego and the one that it touched."""
    crashed = 0
    for slot in range(count):
        fresh = after[slot].crashed and not before[slot].crashed
        if fresh and slot != ego and after[slot].identity != touched:
            crashed += 1
    return crashed
