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
from socialiq_recordings.world.geometry import four

limited = kernel(model.limited)

_S11 = np.uint64(11)
_ONE = np.uint64(1)
_UNIT = 2.0**-53


@kernel
def uniform(seed, purpose, number):
    """Return a number in [0, 1) that is a function of its arguments alone.

    Args:
        seed: Seed of the episode.
        purpose: Number of the purpose, from 0.
        number: Number of the draw for this purpose, as that of a vehicle, from 0.
    """
    word = hashed(seed + GOLDEN * np.uint64(purpose + 1))
    word = hashed(word + GOLDEN * np.uint64(number + 1))
    return np.float64(word >> _S11) * _UNIT


@kernel
def normal(seed, purpose, number):
    """Return a standard normal number (Box and Muller 1958), a function of its arguments alone.

    Args:
        seed: Seed of the episode.
        purpose: Number of the purpose, from 0; two purposes of `uniform` are used for it.
        number: Number of the draw for this purpose, as that of a vehicle, from 0.
    """
    first = uniform(seed, 2 * purpose, number)
    second = uniform(seed, 2 * purpose + 1, number)
    return math.sqrt(-2.0 * math.log(1.0 - first)) * math.cos(2.0 * math.pi * second)


@kernel
def following(seed):
    """Return the seed of the next episode of a stream."""
    return hashed(seed + GOLDEN) + _ONE


WAITING, PRESENT, GONE = range(3)  # states of a vehicle in an episode
DT = 0.1  # s of a sub-step; 1 / SUB_STEPS
V0, T, S0, A, B, MARGIN = range(6)  # parameters of a driver, as in `drivers.Drivers`

_SOON = 8.0  # s; vehicles that arrive later at a conflict area are not yielded to
_CLEAR = 0.5  # s between a vehicle that leaves a conflict area and the next
_STOPS = 5.0  # m/s²; who would have to brake harder goes on
_STARTING = 1.0  # m/s; slower vehicles are taken to accelerate
_CREEP = 0.3  # m/s; least speed of a projection


@kernel
def idm(speed, gap, leader_speed, desired, headway, jam, strongest, comfort):
    """Return `idm.acceleration`, m/s².

    Args:
        speed: Speed of the follower, m/s.
        gap: Distance to the leader's rear, m; infinite without a leader.
        leader_speed: Speed of the leader, m/s.
        desired: Desired speed v0, m/s.
        headway: Time headway T, s.
        jam: Jam distance s0, m.
        strongest: Largest acceleration a, m/s².
        comfort: Comfortable deceleration b, m/s², positive.
    """
    share = speed / desired
    power = share * share * share * share
    return limited(speed, gap, leader_speed, power, headway, jam, strongest, comfort)


@kernel
def time_to(distance, speed, strongest, fastest):
    """Return the time for a distance, accelerating up to a speed, s.

    Args:
        distance: The distance, m; it takes no time if it is not above 0.
        speed: Speed at the start, m/s.
        strongest: Acceleration, m/s².
        fastest: Speed from which it is constant, m/s.
    """
    if distance <= 0.0:
        return 0.0
    if speed >= fastest:
        return distance / max(speed, _CREEP)
    rising = (fastest * fastest - speed * speed) / (2.0 * strongest)
    if distance <= rising:
        return (math.sqrt(speed * speed + 2.0 * strongest * distance) - speed) / strongest
    return (fastest - speed) / strongest + (distance - rising) / fastest


@kernel
def count_of(road, episode):
    """Return the number of vehicles of an episode's recording.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
    """
    recording = episode.recording
    return road.recording_first[recording + 1] - road.recording_first[recording]


@kernel
def pair_of(road, episode, car, partner):
    """Return the number of a pair of vehicles.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        car: Record of the first vehicle.
        partner: Record of the second vehicle.
    """
    first = road.pair_first[episode.recording]
    return first + car.identity * count_of(road, episode) + partner.identity


@kernel
def limit_at(road, car):
    """Return the largest speed at a vehicle's place on its way, m/s.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        car: Record of the vehicle.
    """
    point = road.line_first[car.way] + max(np.int64(car.along), 0)
    return road.line[min(point, road.line_first[car.way + 1] - 1), 3]


@kernel
def ahead_of(road, pair, along, position):
    """Return the coordinate of another vehicle on one's way, m.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        pair: Number of the pair, with oneself first.
        along: Coordinate of that vehicle on the way it drives, m.
        position: One's coordinate on one's way, m.

    Returns:
        Minus infinity if the vehicle is not ahead of `position` on one's way.
    """
    for number in range(road.stretch_first[pair], road.stretch_first[pair + 1]):
        begin, end, low, high = four(road.stretch, number)
        if begin <= along <= end:
            at = low + (along - begin) * (high - low) / (end - begin)
            if at > position:
                return at
    return -math.inf


@kernel
def closed_line(road, way, front, now):
    """Return the coordinate of the next line that is closed to a vehicle, m; infinity if none is.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        way: Number of the vehicle's way.
        front: Coordinate of its front on its way, m.
        now: Time from the recording's first frame, s.
    """
    for number in range(road.closed_first[way], road.closed_first[way + 1]):
        at = road.closed[number, 0]
        if at > front and road.closed[number, 1] <= now < road.closed[number, 2]:
            return at
    return math.inf


@kernel
def waits(gap, through, speed, strongest, desired, margin, their_gap, their_through, their_speed,
          rule, ranked):  # fmt: skip
    """Whether a vehicle may not enter a conflict area now.

    Args:
        gap: Distance from its front to the area, m.
        through: Distance that it drives until its rear has left the area, m.
        speed: Its speed, m/s.
        strongest: Its largest acceleration, m/s².
        desired: Its desired speed, m/s.
        margin: Time that it leaves before a vehicle with the right of way, s.
        their_gap: Distance from the second vehicle's front to the area, m; 0 or less if that is in
            it.
        their_through: Distance that the second vehicle drives until its rear has left the area, m.
        their_speed: Speed of the second vehicle, m/s.
        rule: 1 if the vehicle yields, -1 if the second does, 0 if the first to come goes first.
        ranked: Whether it goes first by rule 0 if both arrive at one moment.
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
def drive(road, episode, vehicles, car):
    """Return a driver's acceleration, m/s², and write what is ahead of it to `barrier`.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        vehicles: VEHICLE records of the episode.
        car: Record of the driver's vehicle.
    """
    speed = car.speed
    along = car.along
    free = car.driver[V0]
    headway = car.driver[T]
    jam = car.driver[S0]
    strongest = car.driver[A]
    comfort = car.driver[B]
    half = 0.5 * car.length
    desired = min(free, limit_at(road, car))
    wait = math.inf
    gap, leader_speed = people.ahead(road, episode, car)
    for slot in range(episode.vehicles):
        partner = vehicles[vehicles[slot].present]
        pair = pair_of(road, episode, car, partner)
        number = road.area_of[pair]
        if number < 0 and road.stretch_first[pair] == road.stretch_first[pair + 1]:
            continue
        other_half = 0.5 * partner.length
        at = ahead_of(road, pair, partner.along, along)
        if at > along and at - along - half - other_half < gap:
            gap = at - along - half - other_half
            leader_speed = partner.speed
        if number < 0:
            continue
        entry, leaving, their_entry, their_leaving = four(road.area, number)
        before = entry - half - along
        their_through = their_leaving + other_half - partner.along
        their_gap = their_entry - other_half - partner.along
        if before <= 0.0 or before >= wait or their_through <= 0.0:
            continue
        if their_gap > 0.0 and partner.barrier < their_entry:
            continue  # something holds it before the area
        through = leaving + half - along
        rule = road.area_yields[number]
        ranked = car.identity < partner.identity
        if waits(before, through, speed, strongest, free, car.driver[MARGIN], their_gap,
                 their_through, partner.speed, rule, ranked):  # fmt: skip
            wait = before
    line = closed_line(road, car.way, along + half, episode.sub_steps * DT)
    to_line = line - along - half
    if speed * speed <= 2.0 * _STOPS * to_line:
        wait = min(wait, to_line + 1.0)
    car.barrier = along + half + min(gap, to_line)
    rate = idm(speed, gap, leader_speed, desired, headway, jam, strongest, comfort)
    if wait < math.inf:
        rate = min(rate, idm(speed, wait, 0.0, desired, headway, jam, strongest, comfort))
    return rate
