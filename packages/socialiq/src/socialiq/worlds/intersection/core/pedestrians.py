"""People on foot at the four crosswalks: arrival, gaps they accept, who brakes for them, contact.

A person is a record of a vehicle in one of the slots behind those of the vehicles. Fields mean:
`origin` the arm; `target_lane` the way along the crosswalk, 1 or -1; `leg` the state below;
`desired_speed` the time of arrival, s; `target_speed` the walking speed, m/s; `time_headway` the
gap accepted at first, s; `jam_distance` the time waited so far, s. Of a decision are
`acceleration`, the time waited, and `max_acceleration`, the part that a person would not have
waited without the ego, s; and `comfort_deceleration`, the closest encounter with it, 0 to 1.
"""

import math
from typing import Any

import numpy as np

from socialiq import physics
from socialiq.worlds.highway.core import rewards, stream
from socialiq.worlds.highway.core.compile import entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.geometry import (
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    distance,
    longitudinal,
)
from socialiq.worlds.highway.core.vehicle import MAX_ACCELERATION, clip
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.highway.options import EPISODE, Contact
from socialiq.worlds.intersection.core.geometry import ACCESS_LENGTH, LANES, ROUTES
from socialiq.worlds.intersection.options import SPEED_LIMIT

ABSENT, WAITING, WALKING, GONE = range(4)
MIDDLE = 15.0  # m from the junction's centre to the middle of a crosswalk
HALF_WIDTH = 1.5  # m, of a crosswalk
KERB = 5.0  # m from the middle of the arm, where people wait
RADIUS = 0.3  # m, of a person
CLASS = 2.0  # in the place of a vehicle's presence in a row of an observation
IDENTITY = 10_000  # of the first person
STANDS = 0.3  # m/s, of a vehicle that stands
GLANCE = 1.0  # s; no person steps before a vehicle that is there sooner
NEAR = 2.0  # s to contact below which an encounter is close

_STOP_LINE = 11.0  # m from the centre
_ON_APPROACH, _ON_EXIT = ACCESS_LENGTH + _STOP_LINE - MIDDLE, MIDDLE - _STOP_LINE
_REACH = HALF_WIDTH + VEHICLE_LENGTH / 2  # m from a crosswalk's middle to who stands beside it
_STRIP = VEHICLE_WIDTH / 2 + RADIUS  # m from the middle of a lane in which a vehicle meets a person
_LANE = 2.0  # m from the middle of an arm to that of a lane
_BRAKING_MARGIN, _BRAKING_HEADWAY, _BRAKING_COMFORT = 1.0, 1.0, 3.0  # m, s, m/s²
_SALT = np.uint64(0x9E3779B97F4A7C15)
_STRUCK = int(Contact.EGO_STRUCK)
_COS, _SIN = np.array([1.0, 0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0, -1.0])  # of arms


@kernel
def schedule(episode, vehicles, settings):
    """Draw who arrives, when, where and how, from a stream that follows from the episode's."""
    own, time = np.empty(1, EPISODE), 0.0
    stream.seed(own[0], episode.state_low ^ _SALT)
    for slot in range(settings.first_walker, settings.first_walker + settings.walkers):
        person = vehicles[slot]
        time -= math.log1p(-stream.uniform(own[0])) / (4 * settings.pedestrian_rate)
        arm, way = stream.up_to(own[0], 3), 2 * stream.up_to(own[0], 1) - 1
        pace = settings.walking_speed + settings.walking_speed_sd * stream.normal(own[0])
        gap = settings.accepted_gap + settings.accepted_gap_sd * stream.normal(own[0])
        person.origin, person.target_lane, person.leg = arm, way, ABSENT
        person.identity, person.agent = IDENTITY + slot - settings.first_walker, -1
        person.desired_speed, person.jam_distance = time, 0.0
        person.target_speed = clip(pace, 0.5, 3.0)
        person.time_headway = max(gap, settings.least_gap)
        person.speed, person.steering, person.crashed = 0.0, 0.0, False
        person.along_x, person.along_y = _COS[arm] * way, _SIN[arm] * way
        person.heading = math.pi / 2 * (arm + 1 - way)
        person.x = -_COS[arm] * way * KERB - _SIN[arm] * MIDDLE
        person.y = -_SIN[arm] * way * KERB + _COS[arm] * MIDDLE
        renew(person)


@kernel
def renew(person):
    """Begin to count a decision."""
    person.acceleration, person.max_acceleration, person.comfort_deceleration = 0.0, 0.0, 0.0


@kernel
def clear(vehicles, settings):
    """Take everybody off, before the traffic's warm-up."""
    for slot in range(settings.first_walker, settings.first_walker + settings.walkers):
        vehicles[slot].leg = GONE


@kernel
def metres_to(vehicle, arm):
    """Return the metres of a vehicle's way from its centre to the middle of an arm's crosswalk.

    The second number is the side of its lane there: 1 of an approach, -1 of an exit, 0 if it does
    not pass this crosswalk. Behind the crosswalk the metres are negative.
    """
    kind, corner = vehicle.lane % 5, vehicle.lane // 5
    lane = LANES[vehicle.lane]
    along = longitudinal(lane, vehicle.x, vehicle.y)
    if kind == APPROACH and corner == arm:
        return _ON_APPROACH - along, 1
    if kind == EXIT:
        return _ON_EXIT - along, -1 if (corner + 3) % 4 == arm else 0
    ahead = lane.length - along + _ON_EXIT
    if kind == APPROACH:
        ahead += LANES[ROUTES[vehicle.origin, vehicle.destination, 1]].length
    return ahead, -1 if vehicle.destination == arm else 0


@kernel
def _across(person):
    """Return the metres along a person's way from the middle of the arm; -`KERB` at its start."""
    x = _COS[person.origin] * person.x + _SIN[person.origin] * person.y
    return x * person.target_lane


@kernel
def _to_lane(person, side):
    """Return the metres that a person has yet to walk to the middle of a lane."""
    return _LANE * side * person.target_lane - _across(person)


@kernel
def brake(vehicles, slot, settings):
    """Let a driver brake for everybody who walks towards its lane or in it."""
    vehicle = vehicles[slot]
    if vehicle.crashed:
        return
    speed = max(vehicle.speed, 0.0)
    for number in range(settings.first_walker, settings.first_walker + settings.walkers):
        person = vehicles[number]
        if person.leg != WALKING:
            continue
        ahead, side = metres_to(vehicle, person.origin)
        gap = ahead - _REACH
        if side == 0 or gap < 0.0 or _to_lane(person, side) < -_STRIP:
            continue
        steady, strongest = _BRAKING_MARGIN + speed * _BRAKING_HEADWAY, vehicle.max_acceleration
        wanted = physics.desired_gap(steady, speed, speed, strongest, _BRAKING_COMFORT)
        ratio = wanted / max(gap, 0.1)
        free = 1.0 - (speed / SPEED_LIMIT) ** 4
        braking = max(strongest * (free - ratio * ratio), -MAX_ACCELERATION)
        vehicle.acceleration = min(vehicle.acceleration, braking)


@kernel
def _side_of_coming(person, vehicle, seconds, skips_agents):
    """Return the lane's side of a vehicle on the crosswalk or there within some seconds; else 0."""
    if skips_agents and vehicle.agent >= 0:
        return 0
    ahead, side = metres_to(vehicle, person.origin)
    gap = ahead - _REACH
    if ahead < -_REACH:
        return 0
    if gap <= 0.0 or (vehicle.speed > STANDS and gap < seconds * vehicle.speed):
        return side
    return 0


@kernel
def _waits(person, vehicles, count, skips_agents, settings):
    """Whether a person at the kerb waits for a vehicle, agents left out if so asked."""
    need = person.time_headway - settings.impatience * person.jam_distance
    need = max(need, settings.least_gap)
    for slot in range(count):
        if _side_of_coming(person, vehicles[slot], need, skips_agents) != 0:
            return True
    return False


@kernel
def _is_stopped(person, vehicles, count, skips_agents):
    """Whether a person on the crosswalk stops for a vehicle that is there, or will be at once."""
    for slot in range(count):
        side = _side_of_coming(person, vehicles[slot], GLANCE, skips_agents)
        if side != 0 and 0.0 < _to_lane(person, side) - _STRIP < 0.5:
            return True
    return False


@kernel
def _meet(episode, person, vehicle):
    """Note how close an agent comes to a person, and whether it strikes the person."""
    ahead, side = metres_to(vehicle, person.origin)
    speed = abs(vehicle.speed)
    if side != 0 and ahead > 0.0 and abs(_to_lane(person, side)) < _STRIP + 1.0:
        seconds = max(ahead - VEHICLE_LENGTH / 2 - RADIUS, 0.0) / max(speed, 0.1)
        closeness = clip(1.0 - seconds / NEAR, 0.0, 1.0)
        person.comfort_deceleration = max(person.comfort_deceleration, closeness)
    dx, dy = person.x - vehicle.x, person.y - vehicle.y
    along = abs(dx * vehicle.along_x + dy * vehicle.along_y)
    aside = abs(dy * vehicle.along_x - dx * vehicle.along_y)
    if along < VEHICLE_LENGTH / 2 + RADIUS and aside < _STRIP and speed > STANDS:
        person.crashed, vehicle.crashed, person.leg = True, True, GONE
        episode.contact[vehicle.agent], episode.touched[vehicle.agent] = _STRUCK, person.identity


@kernel
def walk(episode, vehicles, settings):
    """Advance everybody on foot by a sub-step, after the vehicles."""
    count, dt = episode.vehicles, settings.dt
    time = (episode.sub_steps - settings.warm_up) * dt
    for slot in range(settings.first_walker, settings.first_walker + settings.walkers):
        person = vehicles[slot]
        if person.leg == ABSENT and person.desired_speed <= time:
            person.leg = WAITING
        if person.leg == ABSENT or person.leg == GONE:
            continue
        if person.leg == WAITING:
            held = _waits(person, vehicles, count, False, settings)
            by_ego = held and not _waits(person, vehicles, count, True, settings)
        else:
            held = _is_stopped(person, vehicles, count, False)
            by_ego = held and not _is_stopped(person, vehicles, count, True)
        person.speed = 0.0 if held else person.target_speed
        if held:
            person.acceleration += dt
            person.jam_distance += dt
            person.max_acceleration += dt if by_ego else 0.0
        else:
            person.leg = WALKING
            person.x += person.along_x * person.speed * dt
            person.y += person.along_y * person.speed * dt
        for number in range(settings.agents):
            ego = episode.controlled[number]
            if ego >= 0 and not vehicles[ego].crashed:
                _meet(episode, person, vehicles[ego])
        if person.leg == WALKING and _across(person) >= KERB:
            person.leg = GONE


@kernel
def _is_near(vehicle, person, seconds, least):
    """Whether a vehicle reaches a person in its lane, or on the way into it, within some seconds.

    It drives as fast as now, and at least as fast as given, m/s.
    """
    ahead, side = metres_to(vehicle, person.origin)
    gap = ahead - _REACH
    if side == 0 or gap < 0.0 or _to_lane(person, side) < -_STRIP:
        return False
    return gap < seconds * max(vehicle.speed, least)


def _near_entry(sources: int):
    @entry_point
    def run(episodes, vehicles, options, seconds, near, first, end):
        settings = options[0]
        walkers = settings.first_walker, settings.first_walker + settings.walkers
        for row in range(first, end):
            ego, near[row] = episodes[row].controlled[0], False
            for slot in range(walkers[0], walkers[1] if ego >= 0 else walkers[0]):
                person = vehicles[row, slot]
                if person.leg == WALKING:
                    least = settings.target_speeds[1]
                    near[row] |= _is_near(vehicles[row, ego], person, seconds, least)
        return sources

    return run


near: Any = _near_entry(fingerprint(__file__))
"""Write whether each ego reaches a person who walks into its lane within some seconds, (row,)."""


@kernel
def observe(vehicles, ego, sight, turns, settings, observation):
    """Write the rows of the nearest people, behind those of the vehicles, by distance."""
    me, first = vehicles[ego], settings.observed_vehicles
    slots, distances = np.empty(settings.walkers, np.int64), np.empty(settings.walkers)
    visible = 0
    for slot in range(settings.first_walker, settings.first_walker + settings.walkers):
        person = vehicles[slot]
        if person.leg == ABSENT or person.leg == GONE:
            continue
        apart, rank = distance(person.x, person.y, me.x, me.y), visible
        while rank > 0 and distances[rank - 1] > apart:
            slots[rank], distances[rank] = slots[rank - 1], distances[rank - 1]
            rank -= 1
        slots[rank], distances[rank] = slot, apart
        visible += 1
    for number in range(min(visible, len(observation) - first)):
        row = observation[first + number]
        rewards.write_row(vehicles[slots[number]], 0.0, 0.0, 0.0, 0.0, sight, turns, row)
        row[0] = CLASS
