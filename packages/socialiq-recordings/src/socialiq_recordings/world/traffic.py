"""Compiled traffic of a recorded junction: IDM along recorded ways, right of way, closed lines.

Vehicles are numbered within their recording, `base` is the first one's number in all. In a sub-step
all vehicles choose from the same positions and speeds. Random numbers are functions of an episode's
seed and of what they are for, by SplitMix64 (Steele, Lea and Flood 2014) as a hash: no draw depends
on the order of others.
"""

import math

import numpy as np

from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.core.splitmix import GOLDEN, hashed
from socialiq_recordings import idm as model
from socialiq_recordings.world import people

limited = kernel(model.limited)

_S11, _ONE = np.uint64(11), np.uint64(1)
_UNIT = 2.0**-53


@kernel
def uniform(seed, purpose, number):
    """Return a number in [0, 1): that of a number and a purpose of an episode."""
    word = hashed(seed + GOLDEN * np.uint64(purpose + 1))
    word = hashed(word + GOLDEN * np.uint64(number + 1))
    return np.float64(word >> _S11) * _UNIT


@kernel
def normal(seed, purpose, number):
    """Return a standard normal number (Box and Muller 1958)."""
    first = uniform(seed, 2 * purpose, number)
    second = uniform(seed, 2 * purpose + 1, number)
    return math.sqrt(-2.0 * math.log(1.0 - first)) * math.cos(2.0 * math.pi * second)


@kernel
def following(seed):
    """Return the seed of the next episode of a stream."""
    return hashed(seed + GOLDEN) + _ONE


WAITING, PRESENT, GONE = range(3)  # states of a vehicle in an episode
DT = 0.1  # s of a sub-step; 1 / SUB_STEPS
_V0, _T, _S0, _A, _B, _MARGIN = range(6)

_SOON = 8.0  # s; vehicles that arrive later at a conflict area are not yielded to
_CLEAR = 0.5  # s between a vehicle that leaves a conflict area and the next
_STOPS = 5.0  # m/s²; who would have to brake harder goes on
_STARTING = 1.0  # m/s; slower vehicles are taken to accelerate
_CREEP = 0.3  # m/s; least speed of a projection


@kernel
def idm(speed, gap, leader_speed, desired, headway, jam, strongest, comfort):
    """Return `idm.acceleration`, m/s²."""
    share = speed / desired
    power = share * share * share * share
    return limited(speed, gap, leader_speed, power, headway, jam, strongest, comfort)


@kernel
def time_to(distance, speed, strongest, fastest):
    """Return the time for a distance, accelerating up to a speed, s."""
    if distance <= 0.0:
        return 0.0
    if speed >= fastest:
        return distance / max(speed, _CREEP)
    rising = (fastest * fastest - speed * speed) / (2.0 * strongest)
    if distance <= rising:
        return (math.sqrt(speed * speed + 2.0 * strongest * distance) - speed) / strongest
    return (fastest - speed) / strongest + (distance - rising) / fastest


@kernel
def limit_at(line_first, line, vehicle, along):
    """Return the largest speed on a vehicle's way, m/s."""
    point = line_first[vehicle] + max(np.int64(along), 0)
    return line[min(point, line_first[vehicle + 1] - 1), 3]


@kernel
def ahead_of(stretch_first, stretch, pair, along, position):
    """Return where another at `along` on its way is on one's own way, m.

    Minus infinity if it isn't there ahead of one's `position`. `pair` has oneself first.
    """
    for number in range(stretch_first[pair], stretch_first[pair + 1]):
        begin, end = stretch[number, 0], stretch[number, 1]
        if begin <= along <= end:
            low, high = stretch[number, 2], stretch[number, 3]
            at = low + (along - begin) * (high - low) / (end - begin)
            if at > position:
                return at
    return -math.inf


@kernel
def closed_line(closed_first, closed, vehicle, front, now):
    """Return the coordinate of the next line that is closed to a vehicle, m; infinity if none is.

    `front` is the coordinate of its front, m, `now` the time from the recording's first frame, s.
    """
    for number in range(closed_first[vehicle], closed_first[vehicle + 1]):
        if closed[number, 0] > front and closed[number, 1] <= now < closed[number, 2]:
            return closed[number, 0]
    return math.inf


@kernel
def waits(gap, through, speed, strongest, desired, margin, their_gap, their_through, their_speed,
          rule, ranked):  # fmt: skip
    """Whether a vehicle may not enter a conflict area now.

    `gap` is from its front to the area, m, `through` from its front to where its rear leaves it;
    the other's gap is 0 or less if it is in the area. `margin` is what it leaves before a vehicle
    with the right of way, s. `rule`: 1 if it yields, -1 if the other does, 0 if who comes first
    goes first, or the `ranked` one if both arrive at one moment.
    """
    arrives = time_to(gap, speed, strongest, max(desired, speed))
    clears = their_through / max(their_speed, _CREEP)
    if their_gap <= 0.0:
        return arrives < clears + _CLEAR
    if their_speed < _STARTING:
        soon = time_to(their_gap, their_speed, 1.5, 8.0)
    else:
        soon = their_gap / their_speed
    if soon > _SOON or speed * speed > 2.0 * _STOPS * gap:
        return False
    if speed >= _STARTING and clears + _CLEAR <= arrives:
        return False  # the other is through before
    if rule < 0 or (rule == 0 and (arrives < soon or (arrives == soon and ranked))):
        return False
    return time_to(through, speed, strongest, max(desired, speed)) + margin > soon


@inlined_kernel
def drive(road, traffic, row, base, count, vehicle, now):
    """Return a driver's acceleration, m/s², and write what is ahead of it to `barrier`.

    `now` is the time from the recording's first frame, s.
    """
    along, speed = traffic.along[row, vehicle], traffic.speed[row, vehicle]
    headway, jam = traffic.driver[row, vehicle, _T], traffic.driver[row, vehicle, _S0]
    strongest, comfort = traffic.driver[row, vehicle, _A], traffic.driver[row, vehicle, _B]
    free, margin = traffic.driver[row, vehicle, _V0], traffic.driver[row, vehicle, _MARGIN]
    half = 0.5 * road.length[base + vehicle]
    pairs = road.pair_first[traffic.recording[row]] + vehicle * count
    desired = min(free, limit_at(road.line_first, road.line, base + vehicle, along))
    recording, wait = traffic.recording[row], math.inf
    gap, leader_speed = people.ahead(road, recording, traffic.step[row], base + vehicle, along)
    for slot in range(traffic.n_present[row]):
        partner = traffic.present[row, slot]
        pair = pairs + partner
        number = road.area_of[pair]
        if number < 0 and road.stretch_first[pair] == road.stretch_first[pair + 1]:
            continue
        their_along, their_speed = traffic.along[row, partner], traffic.speed[row, partner]
        other_half = 0.5 * road.length[base + partner]
        at = ahead_of(road.stretch_first, road.stretch, pair, their_along, along)
        if at > along and at - along - half - other_half < gap:
            gap, leader_speed = at - along - half - other_half, their_speed
        if number < 0:
            continue
        before = road.area[number, 0] - half - along
        their_through = road.area[number, 3] + other_half - their_along
        their_gap = road.area[number, 2] - other_half - their_along
        if before <= 0.0 or before >= wait or their_through <= 0.0:
            continue
        if their_gap > 0.0 and traffic.barrier[row, partner] < road.area[number, 2]:
            continue  # something holds it before the area
        through = road.area[number, 1] + half - along
        rule = road.area_yields[number]
        if waits(before, through, speed, strongest, free, margin, their_gap, their_through,
                 their_speed, rule, vehicle < partner):  # fmt: skip
            wait = before
    line = closed_line(road.closed_first, road.closed, base + vehicle, along + half, now)
    to_line = line - along - half
    if speed * speed <= 2.0 * _STOPS * to_line:
        wait = min(wait, to_line + 1.0)
    traffic.barrier[row, vehicle] = along + half + min(gap, to_line)
    rate = idm(speed, gap, leader_speed, desired, headway, jam, strongest, comfort)
    if wait < math.inf:
        rate = min(rate, idm(speed, wait, 0.0, desired, headway, jam, strongest, comfort))
    return rate
