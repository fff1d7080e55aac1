"""People on foot at the four crosswalks and on bicycles: arrival, gaps, who brakes, contact.

A person is a record of a vehicle in one of the slots behind those of the vehicles. Fields mean:
`lane` the class, a row of the tables below; `origin` the arm; `target_lane` on foot the way along
the crosswalk, 1 or -1; `leg` the state below; `desired_speed` the time of arrival, s;
`target_speed` the speed of who is free, m/s; `time_headway` the gap accepted at first, s;
`jam_distance` the time lost so far, s. Of a decision are `acceleration`, the time lost by waiting,
and `max_acceleration`, the part that a person would not have lost without the ego, s; `push_x`, the
speed lost by braking for the ego, m/s; and `comfort_deceleration`, the closest encounter with it, 0
to 1.

A person moves along a straight way, with coordinates from its middle: a crosswalk, or a bicycle
lane beside the right edges of an approach and of the exit straight on.
"""

import math
from typing import Any

import numpy as np

from socialiq import physics
from socialiq.worlds.highway import options as columns
from socialiq.worlds.highway.core import rewards, stream
from socialiq.worlds.highway.core.compile import allocating_kernel, entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.geometry import (
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    distance,
    longitudinal,
)
from socialiq.worlds.highway.core.vehicle import MAX_ACCELERATION, clip
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.highway.options import (
    ABSENT,
    EPISODE,
    GONE,
    WAITING,
    WALKING,
    Contact,
)
from socialiq.worlds.intersection.core.geometry import ACCESS_LENGTH, LANES, ROUTES
from socialiq.worlds.intersection.core.traffic import route_coordinate
from socialiq.worlds.intersection.options import SPEED_LIMIT

MIDDLE = 15.0  # m from the junction's centre to the middle of a crosswalk
HALF_WIDTH = 1.5  # m, of a crosswalk
BESIDE = 4.75  # m from the middle of the arm to that of a bicycle lane
CLASS = 2.0  # on foot, in the place of a vehicle's presence in a row of an observation
IDENTITY = 10_000  # of the first person
STANDS = 0.3  # m/s, of a vehicle that stands
NEAR = 2.0  # s to contact below which an encounter is close

_STOP_LINE = 11.0  # m from the centre
ON_FOOT, RIDES = range(2)
# By class. A rider is 1.8 m long and 0.75 m wide, of round ends.
START = np.array([5.0, 30.0])  # m before and behind the middle of a way, where it begins and ends
_LINE = np.array([5.0, _STOP_LINE])  # m before the middle, where people wait for a gap
RADIUS, LENGTH = np.array([0.3, 0.375]), np.array([0.0, 1.05])  # m, half of the width; the straight
_STRIP = np.array([VEHICLE_WIDTH / 2 + 0.3, 2.5])  # m of a way, either side, that a vehicle covers
_MARGIN = np.array([1.0, 3.5])  # m before this, from which an encounter counts
_LOOK = np.array([0.5, 4.5])  # m before this, at which a person looks again
_GLANCE = np.array([1.0, 1.5])  # s; there no person goes on before a vehicle that is there sooner
_BRAKES, _PICKS_UP = np.array([1e6, 3.0]), np.array([1e6, 1.0])  # m/s²
_ON_APPROACH, _ON_EXIT = ACCESS_LENGTH + _STOP_LINE - MIDDLE, MIDDLE - _STOP_LINE
_BEHIND = LENGTH[1] + 2 * RADIUS[1] + 0.5  # m from a rider's middle to that of the one ahead
_REACH = HALF_WIDTH + VEHICLE_LENGTH / 2  # m from a crosswalk's middle to who stands beside it
_LANE = 2.0  # m from the middle of an arm to that of a lane
_BRAKING_MARGIN, _BRAKING_HEADWAY, _BRAKING_COMFORT = 1.0, 1.0, 3.0  # m, s, m/s²
_SALT = np.array([0x9E3779B97F4A7C15, 0xD1B54A32D192ED03], np.uint64)
_STRUCK = int(Contact.EGO_STRUCK)
_COS, _SIN = np.array([1.0, 0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0, -1.0])  # of arms


def _crossings() -> np.ndarray:
    """Return where routes cross bicycle lanes, (origin, destination, arm, 2), -inf for nowhere.

    The first number is along the route, the second along the way of who rides in from the arm, m.
    """
    places = np.full((4, 4, 4, 2), -np.inf)
    for origin, destination in np.argwhere(~np.eye(4, dtype=bool)):
        lane = LANES[ROUTES[origin, destination, 1]]
        along = np.linspace(0.0, float(lane["length"]), 2001)
        x, y = lane["x"] + along * lane["along_x"], lane["y"] + along * lane["along_y"]
        if not lane["straight"]:
            angle = lane["phase"] + lane["sense"] * along / lane["radius"]
            x = lane["x"] + lane["radius"] * np.cos(angle)
            y = lane["y"] + lane["radius"] * np.sin(angle)
        for arm in range(4):
            aside = _COS[arm] * x + _SIN[arm] * y - BESIDE
            for place in np.flatnonzero(np.diff(np.sign(aside)))[:1]:
                across = _SIN[arm] * x[place] - _COS[arm] * y[place]
                places[origin, destination, arm] = ACCESS_LENGTH + along[place], across
    return places


_CROSSINGS = _crossings()


@allocating_kernel
def schedule(episode, vehicles, settings):
    """Draw who arrives, when, where and how, from streams that follow from the episode's."""
    own = np.empty(1, EPISODE)
    last = settings.first_walker + settings.walkers
    begins = (settings.first_walker, last - settings.riders, last)
    for kind in range(2):
        table, time = settings.people[kind], 0.0
        stream.seed(own[0], episode.state_low ^ _SALT[kind])
        for slot in range(begins[kind], begins[kind + 1]):
            person = vehicles[slot]
            time -= math.log1p(-stream.uniform(own[0])) / (4 * table[columns.RATE])
            arm, way = stream.up_to(own[0], 3), 2 * stream.up_to(own[0], 1) - 1
            pace = table[columns.SPEED] + table[columns.SPEED_SD] * stream.normal(own[0])
            gap = table[columns.GAP] + table[columns.GAP_SD] * stream.normal(own[0])
            person.lane, person.identity = kind, IDENTITY + slot - settings.first_walker
            person.origin, person.target_lane, person.leg, person.agent = arm, way, ABSENT, -1
            person.desired_speed, person.jam_distance = time, 0.0
            person.target_speed = clip(pace, 0.5 + 1.5 * kind, 3.0 + 5.0 * kind)
            person.time_headway = max(gap, table[columns.LEAST_GAP])
            person.steering, person.crashed = 0.0, False
            _begin(person, kind)


@kernel
def _begin(person, kind):
    """Place a person at the start of its way; who rides comes at its speed."""
    arm, way = person.origin, person.target_lane
    if kind == ON_FOOT:
        person.speed, turn = 0.0, arm + 1 - way
        person.along_x, person.along_y = _COS[arm] * way, _SIN[arm] * way
        x, y = -_SIN[arm] * MIDDLE, _COS[arm] * MIDDLE
    else:
        person.speed, turn = person.target_speed, arm - 1
        person.along_x, person.along_y = _SIN[arm], -_COS[arm]
        x, y = _COS[arm] * BESIDE, _SIN[arm] * BESIDE
    person.heading = math.pi / 2 * turn
    person.x, person.y = x - person.along_x * START[kind], y - person.along_y * START[kind]
    person.acceleration, person.max_acceleration = 0.0, 0.0
    person.comfort_deceleration, person.push_x = 0.0, 0.0


@kernel
def clear(vehicles, settings):
    """Take everybody off, before the traffic's warm-up."""
    for slot in range(settings.first_walker, settings.first_walker + settings.walkers):
        vehicles[slot].leg = GONE


@kernel
def _to_crosswalk(vehicle, arm):
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
def to_meeting(vehicle, person):
    """Return the metres to the place where ways cross: of the vehicle, and of the person.

    The first is from its centre, and -inf if the ways don't cross. Behind the place they are
    negative.
    """
    if person.lane == ON_FOOT:
        ahead, side = _to_crosswalk(vehicle, person.origin)
        if side == 0:
            return -np.inf, 0.0
        return ahead, _LANE * side * person.target_lane - _across(person)
    crossing = _CROSSINGS[vehicle.origin, vehicle.destination, person.origin]
    return crossing[0] - route_coordinate(vehicle, 0), crossing[1] - _across(person)


@kernel
def _across(person):
    """Return the metres along a person's way from its middle."""
    return person.along_x * person.x + person.along_y * person.y


@kernel
def brake(vehicles, slot, settings):
    """Let a driver brake for everybody who walks or rides towards its lane or in it."""
    vehicle = vehicles[slot]
    if vehicle.crashed:
        return
    speed = max(vehicle.speed, 0.0)
    for number in range(settings.first_walker, settings.first_walker + settings.walkers):
        person = vehicles[number]
        if person.leg != WALKING:
            continue
        ahead, to_lane = to_meeting(vehicle, person)
        gap = ahead - _REACH
        if gap < 0.0 or to_lane < -_STRIP[person.lane]:
            continue
        steady, strongest = _BRAKING_MARGIN + speed * _BRAKING_HEADWAY, vehicle.max_acceleration
        wanted = physics.desired_gap(steady, speed, speed, strongest, _BRAKING_COMFORT)
        ratio = wanted / max(gap, 0.1)
        free = 1.0 - (speed / SPEED_LIMIT) ** 4
        braking = max(strongest * (free - ratio * ratio), -MAX_ACCELERATION)
        vehicle.acceleration = min(vehicle.acceleration, braking)


@kernel
def _to_coming(person, vehicle, seconds, skips_agents):
    """Return a person's metres to a vehicle on its way or there within some seconds; else -inf."""
    if skips_agents and vehicle.agent >= 0:
        return -np.inf
    ahead, to_lane = to_meeting(vehicle, person)
    gap = ahead - _REACH
    if ahead < -_REACH:
        return -np.inf
    if gap <= 0.0 or (vehicle.speed > STANDS and gap < seconds * vehicle.speed):
        return to_lane
    return -np.inf


@kernel
def _is_held(person, vehicles, count, skips_agents, settings):
    """Whether a person waits or stops for a vehicle, agents left out if so asked.

    Before its line it waits for a gap; behind it, it stops for who is there or will be at once.
    """
    kind = person.lane
    waits, table = person.leg == WAITING, settings.people[kind]
    need = person.time_headway - table[columns.IMPATIENCE] * person.jam_distance
    need = max(need, table[columns.LEAST_GAP]) if waits else _GLANCE[kind]
    for slot in range(count):
        to_lane = _to_coming(person, vehicles[slot], need, skips_agents)
        if to_lane > -np.inf and (waits or 0.0 < to_lane - _STRIP[kind] < _LOOK[kind]):
            return True
    return False


@kernel
def _meet(episode, person, vehicle):
    """Note how close an agent comes to a person, and whether it strikes the person."""
    kind, speed = person.lane, abs(vehicle.speed)
    ahead, to_lane = to_meeting(vehicle, person)
    if ahead > 0.0 and abs(to_lane) < _STRIP[kind] + _MARGIN[kind]:
        seconds = max(ahead - VEHICLE_LENGTH / 2 - RADIUS[kind], 0.0) / max(speed, 0.1)
        closeness = clip(1.0 - seconds / NEAR, 0.0, 1.0)
        person.comfort_deceleration = max(person.comfort_deceleration, closeness)
    dx, dy = person.x - vehicle.x, person.y - vehicle.y
    along = abs(dx * vehicle.along_x + dy * vehicle.along_y)
    aside = abs(dy * vehicle.along_x - dx * vehicle.along_y)
    cosine = person.along_x * vehicle.along_x + person.along_y * vehicle.along_y
    sine = person.along_y * vehicle.along_x - person.along_x * vehicle.along_y
    along -= LENGTH[kind] / 2 * abs(cosine)
    aside -= LENGTH[kind] / 2 * abs(sine)
    long, wide = VEHICLE_LENGTH / 2 + RADIUS[kind], VEHICLE_WIDTH / 2 + RADIUS[kind]
    if along < long and aside < wide and speed > STANDS:
        person.crashed, vehicle.crashed, person.leg = True, True, GONE
        episode.contact[vehicle.agent], episode.touched[vehicle.agent] = _STRUCK, person.identity


@kernel
def _behind(vehicles, slot, settings):
    """Return the speed at which a rider can still stop behind the one ahead of it, m/s.

    Riders of an arm keep the order of their arrival. Who is due and has no room yet is ahead too.
    """
    person = vehicles[slot]
    for number in range(slot - 1, settings.first_walker - 1, -1):
        ahead = vehicles[number]
        if ahead.lane != person.lane or ahead.origin != person.origin or ahead.leg == GONE:
            continue
        gap = _across(ahead) - _across(person) - _BEHIND
        if ahead.leg == ABSENT or gap < 0.0:
            return 0.0
        return math.sqrt(ahead.speed * ahead.speed + 2.0 * _BRAKES[RIDES] * gap)
    return np.inf


@kernel
def walk(episode, vehicles, settings):
    """Advance all people by a sub-step, after the vehicles."""
    count, dt = episode.vehicles, settings.dt
    time = (episode.sub_steps - settings.warm_up) * dt
    for slot in range(settings.first_walker, settings.first_walker + settings.walkers):
        person = vehicles[slot]
        fastest = np.inf if person.lane == ON_FOOT else _behind(vehicles, slot, settings)
        if person.leg == ABSENT and person.desired_speed <= time and person.speed <= fastest:
            person.leg = WAITING
        if person.leg == ABSENT or person.leg == GONE:
            continue
        held = _is_held(person, vehicles, count, False, settings)
        by_ego = held and not _is_held(person, vehicles, count, True, settings)
        _advance(person, held, by_ego, fastest, dt)
        for number in range(settings.agents):
            ego = episode.controlled[number]
            if ego >= 0 and not vehicles[ego].crashed:
                _meet(episode, person, vehicles[ego])
        if person.leg == WALKING and _across(person) >= START[person.lane]:
            person.leg = GONE


@kernel
def _advance(person, held, by_ego, fastest, dt):
    """Move a person who is held or free, at most at a speed, and count what it loses."""
    kind, before, wanted = person.lane, person.speed, person.target_speed
    brakes = _BRAKES[kind]
    if person.leg == WAITING:
        remaining = max(-_LINE[kind] - _across(person), 0.0)
        if held:
            wanted = min(wanted, math.sqrt(2.0 * brakes * remaining))
        elif remaining <= before * before / (2.0 * brakes):
            person.leg = WALKING
    elif held:
        wanted = 0.0
    wanted = min(wanted, fastest)
    person.speed = clip(wanted, max(before - brakes * dt, 0.0), before + _PICKS_UP[kind] * dt)
    if held:
        lost = dt * (1.0 - person.speed / person.target_speed)
        person.acceleration += lost
        person.jam_distance += lost
        person.max_acceleration += lost if by_ego else 0.0
        person.push_x += max(before - person.speed, 0.0) if by_ego else 0.0
    person.x += person.along_x * person.speed * dt
    person.y += person.along_y * person.speed * dt


@kernel
def _is_near(vehicle, person, seconds, least):
    """Whether a vehicle reaches a person in its lane, or on the way into it, within some seconds.

    It drives as fast as now, and at least as fast as given, m/s.
    """
    ahead, to_lane = to_meeting(vehicle, person)
    gap = ahead - _REACH
    if gap < 0.0 or to_lane < -_STRIP[person.lane]:
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
"""Write whether each ego reaches a person who comes into its lane within some seconds, (row,)."""


@allocating_kernel
def observe(vehicles, ego, sight, turns, settings, observation):
    """Write the rows of the nearest people of each class, behind the vehicles', by distance."""
    me, first = vehicles[ego], settings.observed_vehicles
    slots, distances = np.empty(settings.walkers, np.int64), np.empty(settings.walkers)
    for kind in range(2):
        visible, rows = 0, int(settings.people[kind, columns.ROWS])
        for slot in range(settings.first_walker, settings.first_walker + settings.walkers):
            person = vehicles[slot]
            if person.lane != kind or person.leg == ABSENT or person.leg == GONE:
                continue
            apart, rank = distance(person.x, person.y, me.x, me.y), visible
            while rank > 0 and distances[rank - 1] > apart:
                slots[rank], distances[rank] = slots[rank - 1], distances[rank - 1]
                rank -= 1
            slots[rank], distances[rank] = slot, apart
            visible += 1
        for number in range(min(visible, rows)):
            row = observation[first + number]
            rewards.write_row(vehicles[slots[number]], 0.0, 0.0, 0.0, 0.0, sight, turns, row)
            row[0] = CLASS + kind
        first += rows
