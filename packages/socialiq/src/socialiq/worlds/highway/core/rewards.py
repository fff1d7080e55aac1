"""Reward pair of thesis 4.1: influence zone, and named signals of a decision, weighted and summed.

Nothing here depends on a road. Quantities of a road (the advance along the route, the zone, which
neighbours count) are arguments, so the same code rewards simulated roads and recorded traffic.
"""

from typing import get_args

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core.compile import allocating_kernel, inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, distance
from socialiq.worlds.highway.core.vehicle import clip
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.highway.options import ENV_SIGNALS, SIGNALS, Counted, Crash, Disruption, Zone

_LAST_20_M, _LAST_8_M, _BEYOND_8_M, _TRAVELLED_8_M = range(len(get_args(Zone)))
_ALL, _CROSS, _APPROACHING = range(len(get_args(Counted)))


@kernel
def in_zone(kind, along, length, travelled, settings):
    """Whether the ego is in the influence zone: the end of its approach, or the junction.

    Kind, coordinate and length, m, are those of its lane; it has travelled so many metres along its
    route since the episode began.
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

    It is so far from the ego, m, and may have entered by the ego's approach; the kind is of its
    target lane: APPROACH, EXIT, or another.
    """
    if apart > settings.conflict_distance:
        return False
    if settings.counted == _ALL:
        return True
    if same_origin or kind == EXIT:
        return False
    return settings.counted == _CROSS or kind == APPROACH


_N_ENV, _N_SIGNALS = len(ENV_SIGNALS), len(SIGNALS)
_DEAD_ZONE, _LITERAL = range(len(get_args(Disruption)))
_OVERRIDE, _ADD = range(len(get_args(Crash)))
_PROGRESS, _SPEED, _STEP, _COLLISION, _ARRIVAL, _TIMEOUT = range(_N_ENV)
_YIELDING, _DISRUPTION, _NEIGHBOUR_COLLISION = range(_N_ENV, _N_SIGNALS)
_ENDINGS = Ending.NONE, Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT, Ending.OTHER
_NO_ENDING, _ARRIVED, _COLLIDED, _TIMED_OUT, _LEFT = map(int, _ENDINGS)


@kernel
def ending_of(crashed, left, arrived, out_of_time):
    """Return the ending of the episode at this snapshot; of several, the first in this order."""
    if crashed:
        return _COLLIDED
    if left:
        return _LEFT
    if arrived:
        return _ARRIVED
    return _TIMED_OUT if out_of_time else _NO_ENDING


@kernel
def env_signals(advance, on_road, speed, ending, settings, signals):
    """Write the signals of r_env (Eq 4.1).

    Collision and arrival replace the other signals of the step; a timeout adds to them. To leave
    the road, where that ends the episode, costs as a collision. The ego advanced so many metres
    along its route; speed, m/s, and whether it is on the road are of the time after the decision.
    """
    signals[:_N_ENV] = 0.0
    if ending in (_COLLIDED, _LEFT):
        signals[_COLLISION] = 1.0
        return
    if ending == _ARRIVED:
        signals[_ARRIVAL] = 1.0
        return
    if on_road:
        signals[_PROGRESS] = advance / settings.progress_unit
        signals[_SPEED] = clip(speed / settings.max_speed, 0.0, 1.0)
    signals[_STEP] = 1.0
    signals[_TIMEOUT] = 1.0 if ending == _TIMED_OUT else 0.0


@kernel
def social_signals(speed, within, counted, lost, ending, settings, signals, braking):
    """Write the signals of r_social (Eq 4.2), 0 where the ego is not within the influence zone.

    By slot are given whether the vehicle is a neighbour that counts, and its loss of speed, m/s;
    written is whether that was charged to the ego.
    """
    braking[:] = False
    signals[_N_ENV:] = 0.0
    if ending == _COLLIDED:  # an ego that leaves the road meets no one
        signals[_NEIGHBOUR_COLLISION] = 1.0
        if settings.crash == _OVERRIDE:
            return
    if not within:
        return
    neighbours = 0
    for slot in range(len(counted)):
        if counted[slot]:
            neighbours += 1
            loss, share = lost[slot], 0.0
            if settings.disruption == _LITERAL:
                loss = max(loss, settings.speed_threshold)
            if settings.disruption == _LITERAL or loss > settings.speed_threshold:
                share = min(loss / settings.speed_cap, 1.0)
            signals[_DISRUPTION] += share
            braking[slot] = share > 0
    signals[_YIELDING] = (1.0 - clip(speed / settings.max_speed, 0.0, 1.0)) * neighbours


@kernel
def pair(signals, settings):
    """Return r_env and r_social, each the weighted sum of its signals."""
    r_env, r_social = 0.0, 0.0
    for number in range(_N_ENV):
        r_env += settings.weights[number] * signals[number]
    for number in range(_N_ENV, _N_SIGNALS):
        r_social += settings.weights[number] * signals[number]
    return r_env, r_social


@inlined_kernel
def classical(before, after, on_road, count, ego, settings):
    """Return the rewards of the classical formulation (thesis A.1): ego and neighbours' mean.

    Each vehicle is rewarded by Eq 4.1 without arrival and timeout; a new collision replaces the
    step's reward. A snapshot has the vehicles at a decision (before) or after its sub-steps
    (after), before clearing and spawning, so a vehicle has the same slot in both.
    """
    ego_reward, neighbours, weights = 0.0, 0.0, settings.weights
    for slot in range(count):
        vehicle, reward = after[slot], weights[_COLLISION]
        if not vehicle.crashed or before[slot].crashed:
            reward = 0.0
            if on_road[slot]:
                advance = distance(vehicle.x, vehicle.y, before[slot].x, before[slot].y)
                ratio = clip(vehicle.speed / settings.max_speed, 0.0, 1.0)
                reward = weights[_PROGRESS] * advance / settings.progress_unit
                reward = reward + weights[_SPEED] * ratio
            reward = reward + weights[_STEP]
        if slot == ego:
            ego_reward = reward
        else:
            neighbours += reward
    return ego_reward, neighbours / max(count - 1, 1)


@kernel
def neighbours_collided(before, after, count, ego, touched):
    """Count vehicles that crashed in this decision, except the ego and the vehicle it touched."""
    crashed = 0
    for slot in range(count):
        fresh = after[slot].crashed and not before[slot].crashed
        if fresh and slot != ego and after[slot].identity != touched:
            crashed += 1
    return crashed


_PERCEPTION = 200.0  # m


@allocating_kernel
def observe(vehicles, count, ego, view, observation):
    """Write the ego's row, then those of the others by distance along the ego's lane.

    The view is the coordinates along the ego's lane by slot, m, the `tie`, the SIGHT record,
    the quarter turns, from east to north, of the frame, and the number of rows of vehicles.

    Vehicles more than 10 m behind are not observed. Vehicles on a crossing lane share a coordinate
    on the ego's lane, so rounding often decides their order; with `tie`, m, the list's order
    decides.
    """
    along, tie, sight, turns, rows = view
    observation[:] = 0.0
    me = vehicles[ego]
    write_row(me, 0.0, 0.0, 0.0, 0.0, sight, turns, observation[0])
    slots, distances, visible = np.empty(count, np.int64), np.empty(count), 0
    for slot in range(count):
        if slot == ego:
            continue
        vehicle = vehicles[slot]
        if not distance(vehicle.x, vehicle.y, me.x, me.y) < _PERCEPTION:
            continue
        ahead = along[slot] - along[ego]
        if not ahead > -2 * VEHICLE_LENGTH:
            continue
        rank = visible
        while rank > 0 and distances[rank - 1] > abs(ahead) + tie:
            slots[rank], distances[rank] = slots[rank - 1], distances[rank - 1]
            rank -= 1
        slots[rank], distances[rank] = slot, abs(ahead)
        visible += 1
    x, y, vx, vy = 0.0, 0.0, 0.0, 0.0
    if sight.relative:
        x, y, vx, vy = me.x, me.y, me.speed * me.along_x, me.speed * me.along_y
    for row in range(min(visible, rows - 1)):
        write_row(vehicles[slots[row]], x, y, vx, vy, sight, turns, observation[row + 1])


@kernel
def write_row(vehicle, x, y, vx, vy, sight, turns, row):
    """Write a row of an observation, position and velocity less those given."""
    dx, dy = _turned(vehicle.x - x, vehicle.y - y, turns)
    along_x, along_y = vehicle.along_x, vehicle.along_y
    speed_x, speed_y = vehicle.speed * along_x - vx, vehicle.speed * along_y - vy
    speed_x, speed_y = _turned(speed_x, speed_y, turns)
    row[0] = 1.0
    row[1], row[2] = _scaled(dx, sight.x), _scaled(dy, sight.y)
    row[3], row[4] = _scaled(speed_x, sight.vx), _scaled(speed_y, sight.vy)
    row[5], row[6] = _turned(along_x, along_y, turns)


@kernel
def _turned(x, y, turns):
    if turns == 0:
        return x, y
    if turns == 1:
        return y, -x
    return (-x, -y) if turns == 2 else (-y, x)


@kernel
def _scaled(value, bound):
    return clip(-1.0 + (value + bound) * 2.0 / (2.0 * bound), -1.0, 1.0)
