"""Reward pair of thesis 4.1: influence zone, and named signals of a decision, weighted and summed.

This module does not depend on a road. Quantities of a road (the advance along the route, the zone,
which neighbours count) are arguments, so the same code rewards simulated roads and recorded
traffic.
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

    Args:
        kind: Kind of the ego's lane: APPROACH, EXIT, or another.
        along: Coordinate of the ego along its lane, m.
        length: Length of this lane, m.
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
    """Whether a neighbour is within the conflict distance and counts by the option `counted`.

    Args:
        apart: Its distance from the ego, m.
        same_origin: Whether it entered by the ego's approach.
        kind: Kind of its target lane: APPROACH, EXIT, or another.
        settings: SETTINGS record.
    """
    if apart > settings.conflict_distance:
        return False
    if settings.counted == _ALL:
        return True
    if same_origin or kind == EXIT:
        return False
    return settings.counted == _CROSS or kind == APPROACH


_N_ENV = len(ENV_SIGNALS)
_N_SIGNALS = len(SIGNALS)
_DEAD_ZONE, _LITERAL = range(len(get_args(Disruption)))
_OVERRIDE, _ADD = range(len(get_args(Crash)))
_PROGRESS, _SPEED, _STEP, _COLLISION, _ARRIVAL, _TIMEOUT = range(_N_ENV)
_YIELDING, _DISRUPTION, _NEIGHBOUR_COLLISION = range(_N_ENV, _N_SIGNALS)
_ENDINGS = Ending.NONE, Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT, Ending.OTHER
_NO_ENDING, _ARRIVED, _COLLIDED, _TIMED_OUT, _LEFT = map(int, _ENDINGS)


@kernel
def ending_of(crashed, left, arrived, out_of_time):
    """Return the ending of the episode at this snapshot; of several, the first in this order.

    Args:
        crashed: Whether the ego has crashed.
        left: Whether it is off the road and that ends the episode.
        arrived: Whether it has arrived.
        out_of_time: Whether the time is over.

    Returns:
        Value of `Ending`.
    """
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

    Collision and arrival replace all further signals of the step; a timeout adds to them. To leave
    the road, where that ends the episode, costs as a collision.

    Args:
        advance: Metres that the ego advanced along its route.
        on_road: Whether it is on the road after the decision.
        speed: Its speed after the decision, m/s.
        ending: Value of `Ending`.
        settings: SETTINGS record.
        signals: Signals in the order of `SIGNALS`, unweighted; those of r_env are written.
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

    Args:
        speed: The ego's speed after the decision, m/s.
        within: Whether the ego is within the influence zone.
        counted: Whether the vehicle of each slot is a neighbour that counts.
        lost: Loss of speed of the vehicle of each slot, m/s.
        ending: Value of `Ending`.
        settings: SETTINGS record.
        signals: Signals in the order of `SIGNALS`, unweighted; those of r_social are written.
        braking: Whether the loss of each slot was charged to the ego, which is written.
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
            loss = lost[slot]
            share = 0.0
            if settings.disruption == _LITERAL:
                loss = max(loss, settings.speed_threshold)
            if settings.disruption == _LITERAL or loss > settings.speed_threshold:
                share = min(loss / settings.speed_cap, 1.0)
            signals[_DISRUPTION] += share
            braking[slot] = share > 0
    signals[_YIELDING] = (1.0 - clip(speed / settings.max_speed, 0.0, 1.0)) * neighbours


@kernel
def pair(signals, settings):
    """Return r_env and r_social, each the weighted sum of its signals.

    Args:
        signals: Signals in the order of `SIGNALS`, unweighted.
        settings: SETTINGS record with the weights.
    """
    r_env = 0.0
    r_social = 0.0
    for number in range(_N_ENV):
        r_env += settings.weights[number] * signals[number]
    for number in range(_N_ENV, _N_SIGNALS):
        r_social += settings.weights[number] * signals[number]
    return r_env, r_social


@inlined_kernel
def classical(before, after, on_road, count, ego, settings):
    """Return the rewards of the classical formulation (thesis A.1): ego and neighbours' mean.

    Each vehicle is rewarded by Eq 4.1 without arrival and timeout; a new collision replaces the
    step's reward. A vehicle has the same slot in both snapshots, which are taken before clearing
    and spawning.

    Args:
        before: Vehicles at the decision.
        after: Vehicles after its sub-steps.
        on_road: Whether the vehicle of each slot is on the road after them.
        count: Number of vehicles.
        ego: Slot of the ego.
        settings: SETTINGS record.
    """
    ego_reward = 0.0
    neighbours = 0.0
    weights = settings.weights
    for slot in range(count):
        vehicle = after[slot]
        reward = weights[_COLLISION]
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
    """Count vehicles that crashed in this decision, except the ego and the vehicle it touched.

    Args:
        before: Vehicles at the decision.
        after: Vehicles after its sub-steps.
        count: Number of vehicles.
        ego: Slot of the ego.
        touched: Identity of the vehicle that the ego touched; -1: none.
    """
    crashed = 0
    for slot in range(count):
        fresh = after[slot].crashed and not before[slot].crashed
        if fresh and slot != ego and after[slot].identity != touched:
            crashed += 1
    return crashed


_PERCEPTION = 200.0  # m


@kernel
def insert(numbers, distances, count, number, distance, tie):
    """Insert a number into `count` numbers sorted by distance, behind those of equal distance.

    Args:
        numbers: The sorted numbers, with space for one more.
        distances: Their distances, m.
        count: How many there are.
        number: Number to insert.
        distance: Its distance, m.
        tie: Difference up to which distances are equal, m.
    """
    rank = count
    while rank > 0 and distances[rank - 1] > distance + tie:
        numbers[rank] = numbers[rank - 1]
        distances[rank] = distances[rank - 1]
        rank -= 1
    numbers[rank] = number
    distances[rank] = distance


@allocating_kernel
def observe(vehicles, count, ego, view, observation):
    """Write the ego's row, then those of further vehicles by distance along the ego's lane.

    Vehicles more than 10 m behind are observed only where options say so. Vehicles on a crossing
    lane share a coordinate on the ego's lane, so rounding often decides their order; with `tie`, m,
    the list's order decides.

    Args:
        vehicles: Records of vehicles.
        count: Number of vehicles.
        ego: Slot of the ego.
        view: Coordinates along the ego's lane by slot, m; the `tie`; the SIGHT record; the cosine
            and sine of the frame's turn, from east to north; the number of rows of vehicles, and
            whether vehicles behind are observed.
        observation: Rows of the observation, which are written.
    """
    along, tie, sight, turn, shown = view
    rows, shows_behind = shown
    observation[:] = 0.0
    me = vehicles[ego]
    write_row(me, 0.0, 0.0, 0.0, 0.0, sight, turn, observation[0])
    slots = np.empty(count, np.int64)
    distances = np.empty(count)
    visible = 0
    for slot in range(count):
        if slot == ego:
            continue
        vehicle = vehicles[slot]
        if not distance(vehicle.x, vehicle.y, me.x, me.y) < _PERCEPTION:
            continue
        ahead = along[slot] - along[ego]
        if not (shows_behind or ahead > -2 * VEHICLE_LENGTH):
            continue
        insert(slots, distances, visible, slot, abs(ahead), tie)
        visible += 1
    x = 0.0
    y = 0.0
    vx = 0.0
    vy = 0.0
    if sight.relative:
        x = me.x
        y = me.y
        vx = me.speed * me.along_x
        vy = me.speed * me.along_y
    for row in range(min(visible, rows - 1)):
        write_row(vehicles[slots[row]], x, y, vx, vy, sight, turn, observation[row + 1])


@kernel
def write_row(vehicle, x, y, vx, vy, sight, turn, row):
    """Write a row of an observation, position and velocity less those given.

    Args:
        vehicle: Record of the vehicle.
        x: x that is subtracted from its position, m.
        y: y that is subtracted, m.
        vx: Velocity to the east that is subtracted, m/s.
        vy: Velocity to the south that is subtracted, m/s.
        sight: SIGHT record with the scales.
        turn: Cosine and sine of the frame's turn, from east to north.
        row: Row of the observation, in the order of `FEATURES`, which is written.
    """
    dx, dy = _turned(vehicle.x - x, vehicle.y - y, turn)
    along_x = vehicle.along_x
    along_y = vehicle.along_y
    speed_x = vehicle.speed * along_x - vx
    speed_y = vehicle.speed * along_y - vy
    speed_x, speed_y = _turned(speed_x, speed_y, turn)
    row[0] = 1.0
    row[1] = _scaled(dx, sight.x)
    row[2] = _scaled(dy, sight.y)
    row[3] = _scaled(speed_x, sight.vx)
    row[4] = _scaled(speed_y, sight.vy)
    row[5], row[6] = _turned(along_x, along_y, turn)


@kernel
def _turned(x, y, turn):
    cos, sin = turn
    if sin == 0:
        return (x, y) if cos > 0 else (-x, -y)
    if cos == 0:
        return (y, -x) if sin > 0 else (-y, x)
    return cos * x + sin * y, cos * y - sin * x


@kernel
def _scaled(value, bound):
    return clip(-1.0 + (value + bound) * 2.0 / (2.0 * bound), -1.0, 1.0)
