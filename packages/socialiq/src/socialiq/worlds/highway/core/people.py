"""People on crosswalks and on bicycle lanes: arrival, gaps, braking drivers, contact.

People are PERSON records (`road_users`). A person moves along one of the ways of the road
(`crossings.WAY`), with coordinates from its middle.
"""

import math
from typing import Any

import numpy as np

from socialiq import physics
from socialiq.worlds.highway.core import rewards, stream
from socialiq.worlds.highway.core.compile import (
    allocating_kernel,
    entry_point,
    fingerprint,
    inlined_kernel,
    kernel,
)
from socialiq.worlds.highway.core.drivers import route_coordinate
from socialiq.worlds.highway.core.geometry import (
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    distance,
    longitudinal,
)
from socialiq.worlds.highway.core.vehicle import MAX_ACCELERATION, clip
from socialiq.worlds.highway.crossings import HALF_WIDTH
from socialiq.worlds.highway.options import EPISODE, Contact
from socialiq.worlds.road_users import (
    ABSENT,
    FIRST_CODE,
    GONE,
    MOST_CLASSES,
    MOVING,
    ON_FOOT,
    RIDES,
    WAITING,
)

IDENTITY = 10_000  # of the first person
NO_AGENT = -1
STANDS = 0.3  # m/s, of a vehicle that stands
NEAR = 2.0  # s to contact below which an encounter is close

# By motion.
_STRIP = np.array([VEHICLE_WIDTH / 2 + 0.3, 2.5])  # m of a way, either side, that a vehicle covers
_MARGIN = np.array([1.0, 3.5])  # m before this, from which an encounter counts
_LOOK = np.array([0.5, 4.5])  # m before this, at which a person looks again
_GLANCE = np.array([1.0, 1.5])  # s; there no person goes on before a vehicle that is there sooner
_BRAKES = np.array([1e6, 3.0])  # m/s²
_PICKS_UP = np.array([1e6, 1.0])  # m/s²
_SLOWEST = np.array([0.5, 2.0])  # m/s
_FASTEST = np.array([3.0, 8.0])  # m/s
_APART = 0.5  # m from a rider to the one ahead
_REACH = HALF_WIDTH + VEHICLE_LENGTH / 2  # m from a crosswalk's middle to who stands beside it
_BRAKING_MARGIN = 1.0  # m
_BRAKING_HEADWAY = 1.0  # s
_BRAKING_COMFORT = 3.0  # m/s²
# Of the streams of arrivals, by class.
_SALT = np.array(
    [0x9E3779B97F4A7C15, 0xD1B54A32D192ED03, 0xABC98388FB8FAC03, 0x8CB92BA72F3D8DD7], np.uint64
)
_STRUCK = int(Contact.EGO_STRUCK)


@allocating_kernel
def schedule(episode, people, road, settings):
    """Draw the arrivals of people, from streams that follow from the episode's.

    The time, the place, the direction, the speed and the accepted gap are drawn for each person.

    Args:
        episode: EPISODE record; its stream is read, not advanced.
        people: PERSON records of the episode, which are written.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    own = np.empty(1, EPISODE)
    number = 0
    for kind in range(MOST_CLASSES):
        table = settings.classes[kind]
        motion = table.motion
        crosswalks = road.crossings.crosswalks
        rides = len(road.crossings.ways) - 2 * crosswalks
        places = crosswalks if motion == ON_FOOT else rides
        time = 0.0
        stream.seed(own[0], episode.state_low ^ _SALT[kind])
        for _ in range(table.persons):
            person = people[number]
            time -= math.log1p(-stream.uniform(own[0])) / (places * table.rate)
            place = stream.up_to(own[0], places - 1)
            back = stream.up_to(own[0], 1)
            pace = table.speed + table.speed_sd * stream.normal(own[0])
            gap = table.gap + table.gap_sd * stream.normal(own[0])
            person.kind = kind
            person.motion = motion
            person.length = table.length
            person.width = table.width
            person.identity = IDENTITY + number
            person.way = 2 * place + back if motion == ON_FOOT else 2 * crosswalks + place
            person.state = ABSENT
            person.arrival = time
            person.waited = 0.0
            person.free_speed = clip(pace, _SLOWEST[motion], _FASTEST[motion])
            person.accepted_gap = max(gap, table.least_gap)
            person.hit = False
            person.hit_by = -1
            _begin(person, road.crossings.ways[person.way])
            number += 1


@kernel
def _begin(person, way):
    """Place a person at the start of its way; a rider comes at its speed."""
    person.speed = 0.0 if person.motion == ON_FOOT else person.free_speed
    person.heading = way.heading
    person.along_x = way.along_x
    person.along_y = way.along_y
    person.x = way.x - way.along_x * way.half
    person.y = way.y - way.along_y * way.half
    person.delay = 0.0


@kernel
def clear(people):
    """Take all people off, before the traffic's warm-up.

    Args:
        people: PERSON records of the episode, which are written.
    """
    for person in people:
        person.state = GONE


@inlined_kernel
def to_meeting(vehicle, person, road):
    """Return the metres of a vehicle and of a person to the place where their ways cross.

    Args:
        vehicle: Record of the vehicle.
        person: Record of the person.
        road: Tables of the road.

    Returns:
        The vehicle's metres from its centre, -inf if the ways don't cross; and the person's metres.
        Both are negative behind the place.
    """
    across = _across(person, road.crossings.ways[person.way])
    if person.motion == ON_FOOT:
        meeting = road.crossings.meetings[person.way // 2, vehicle.lane, vehicle.destination]
        if meeting.base == -np.inf:
            return -np.inf, 0.0
        along = longitudinal(road.lanes[vehicle.lane], vehicle.x, vehicle.y)
        ahead = meeting.base - along + meeting.place + meeting.between
        sense = 2 * (person.way % 2) - 1  # the first way of a crosswalk leads back
        return ahead, meeting.across * sense - across
    ride = person.way - 2 * road.crossings.crosswalks
    crossing = road.crossings.ridden[vehicle.route, vehicle.destination, ride]
    ahead = crossing[0] - route_coordinate(vehicle, road.lanes, road.routes)
    return ahead, crossing[1] - across


@kernel
def _across(person, way):
    """Return the metres along a person's way from its middle."""
    return person.along_x * (person.x - way.x) + person.along_y * (person.y - way.y)


@kernel
def brake(vehicles, count, people, road):
    """Let drivers brake for all people that walk or ride towards their lane or in it.

    Args:
        vehicles: Records of the episode's vehicles; accelerations of drivers are lowered.
        count: Number of vehicles.
        people: PERSON records of the episode.
        road: Tables of the road.
    """
    for slot in range(count):
        vehicle = vehicles[slot]
        if vehicle.agent < 0 and not vehicle.crashed:
            _brake(vehicle, people, road)


@inlined_kernel
def _brake(vehicle, people, road):
    """Lower the acceleration of a driver's vehicle for all people."""
    speed = max(vehicle.speed, 0.0)
    fastest = road.lanes[vehicle.lane].speed_limit
    for person in people:
        if person.state != MOVING:
            continue
        ahead, to_lane = to_meeting(vehicle, person, road)
        gap = ahead - _REACH
        if gap < 0.0 or to_lane < -_STRIP[person.motion]:
            continue
        steady = _BRAKING_MARGIN + speed * _BRAKING_HEADWAY
        strongest = vehicle.max_acceleration
        wanted = physics.desired_gap(steady, speed, speed, strongest, _BRAKING_COMFORT)
        ratio = wanted / max(gap, 0.1)
        free = 1.0 - (speed / fastest) ** 4
        braking = max(strongest * (free - ratio * ratio), -MAX_ACCELERATION)
        vehicle.acceleration = min(vehicle.acceleration, braking)


@inlined_kernel
def _to_coming(person, vehicle, road, seconds):
    """Return a person's metres to the lane of a vehicle that is on its way, or soon will be.

    The result is -inf for a vehicle that is not on the person's way within the seconds.
    """
    ahead, to_lane = to_meeting(vehicle, person, road)
    gap = ahead - _REACH
    if ahead < -_REACH:
        return -np.inf
    if gap <= 0.0 or (vehicle.speed > STANDS and gap < seconds * vehicle.speed):
        return to_lane
    return -np.inf


@kernel
def _is_held(person, vehicles, count, road, absent, settings):
    """Whether a person waits or stops for a vehicle, that of the agent `absent` left out.

    Before its line it waits for a gap; behind it, it stops for a vehicle that is on its way or will
    be at once.
    """
    motion = person.motion
    waits = person.state == WAITING
    table = settings.classes[person.kind]
    need = person.accepted_gap - table.impatience * person.waited
    need = max(need, table.least_gap) if waits else _GLANCE[motion]
    for slot in range(count):
        if absent >= 0 and vehicles[slot].agent == absent:
            continue
        to_lane = _to_coming(person, vehicles[slot], road, need)
        if to_lane > -np.inf and (waits or 0.0 < to_lane - _STRIP[motion] < _LOOK[motion]):
            return True
    return False


@inlined_kernel
def _meet(episode, person, vehicle, influence, road):
    """Note how close an agent comes to a person, and whether it strikes the person."""
    motion = person.motion
    speed = abs(vehicle.speed)
    radius = person.width / 2
    straight = person.length - person.width  # a person has round ends
    ahead, to_lane = to_meeting(vehicle, person, road)
    if ahead > 0.0 and abs(to_lane) < _STRIP[motion] + _MARGIN[motion]:
        seconds = max(ahead - VEHICLE_LENGTH / 2 - radius, 0.0) / max(speed, 0.1)
        closeness = clip(1.0 - seconds / NEAR, 0.0, 1.0)
        influence.encounter = max(influence.encounter, closeness)
    dx = person.x - vehicle.x
    dy = person.y - vehicle.y
    along = abs(dx * vehicle.along_x + dy * vehicle.along_y)
    aside = abs(dy * vehicle.along_x - dx * vehicle.along_y)
    cosine = person.along_x * vehicle.along_x + person.along_y * vehicle.along_y
    sine = person.along_y * vehicle.along_x - person.along_x * vehicle.along_y
    along -= straight / 2 * abs(cosine)
    aside -= straight / 2 * abs(sine)
    long = VEHICLE_LENGTH / 2 + radius
    wide = VEHICLE_WIDTH / 2 + radius
    if along < long and aside < wide and speed > STANDS:
        person.hit = True
        person.hit_by = vehicle.agent
        vehicle.crashed = True
        person.state = GONE
        episode.contact[vehicle.agent] = _STRUCK
        episode.touched[vehicle.agent] = person.identity


@kernel
def _speed_behind(people, person, way):
    """Return the speed at which a person can still stop behind the rider ahead of it, m/s.

    It is infinite on foot. Riders of a lane keep the order of their arrival, whatever their class.
    A rider that is due and has no room yet counts as ahead too.
    """
    if person.motion == ON_FOOT:
        return np.inf
    latest = -1
    for number in range(len(people)):
        other = people[number]
        if other.motion == ON_FOOT or other.way != person.way or other.state == GONE:
            continue
        if other.arrival >= person.arrival:
            continue
        if latest < 0 or people[latest].arrival < other.arrival:
            latest = number
    if latest < 0:
        return np.inf
    ahead = people[latest]
    gap = _across(ahead, way) - _across(person, way) - ((ahead.length + person.length) / 2 + _APART)
    if ahead.state == ABSENT or gap < 0.0:
        return 0.0
    return math.sqrt(ahead.speed * ahead.speed + 2.0 * _BRAKES[RIDES] * gap)


@kernel
def walk(episode, vehicles, people, influences, road, settings):
    """Advance all people by a sub-step, after the vehicles.

    Args:
        episode: EPISODE record; an agent that strikes a person gets its contact.
        vehicles: Records of the episode's vehicles.
        people: PERSON records of the episode, which are written.
        influences: INFLUENCE records, (agent, person), which are written.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    count = episode.vehicles
    dt = settings.dt
    time = (episode.sub_steps - settings.warm_up) * dt
    for which in range(len(people)):
        person = people[which]
        if person.state == GONE or (person.state == ABSENT and person.arrival > time):
            continue
        way = road.crossings.ways[person.way]
        fastest = _speed_behind(people, person, way)
        if person.state == ABSENT:
            if person.speed > fastest:
                continue
            person.state = WAITING
        held = _is_held(person, vehicles, count, road, NO_AGENT, settings)
        holding = 0  # one bit per agent without which the person would go on
        if held:
            for number in range(settings.agents):
                if not _is_held(person, vehicles, count, road, number, settings):
                    holding |= 1 << number
        lost, slowed = _advance(person, way, held, holding, fastest, dt)
        for number in range(settings.agents):
            influence = influences[number, which]
            if holding >> number & 1:
                influence.delay += lost
                influence.lost_speed += slowed
            ego = episode.controlled[number]
            if ego >= 0 and not vehicles[ego].crashed:
                _meet(episode, person, vehicles[ego], influence, road)
        if person.state == MOVING and _across(person, way) >= way.half:
            person.state = GONE


@kernel
def _advance(person, way, held, holding, fastest, dt):
    """Move a person by a sub-step; return the seconds and the speed that it loses, s and m/s.

    `held` is whether it waits or stops, `holding` is above 0 if it would not without some agent,
    and `fastest` is the largest speed, m/s.
    """
    motion = person.motion
    before = person.speed
    wanted = person.free_speed
    brakes = _BRAKES[motion]
    if person.state == WAITING:
        remaining = max(-way.line - _across(person, way), 0.0)
        if held:
            wanted = min(wanted, math.sqrt(2.0 * brakes * remaining))
        elif remaining <= before * before / (2.0 * brakes):
            person.state = MOVING
    elif held:
        wanted = 0.0
    wanted = min(wanted, fastest)
    person.speed = clip(wanted, max(before - brakes * dt, 0.0), before + _PICKS_UP[motion] * dt)
    lost = dt * (1.0 - person.speed / person.free_speed)
    if held:
        person.waited += lost
        person.delay += lost if holding else 0.0
    person.x += person.along_x * person.speed * dt
    person.y += person.along_y * person.speed * dt
    return lost, max(before - person.speed, 0.0)


@inlined_kernel
def _is_near(vehicle, person, road, seconds, least):
    """Whether a vehicle reaches a person in its lane, or on the way into it, within some seconds.

    It drives as fast as now, and at least as fast as given, m/s.
    """
    ahead, to_lane = to_meeting(vehicle, person, road)
    gap = ahead - _REACH
    if gap < 0.0 or to_lane < -_STRIP[person.motion]:
        return False
    return gap < seconds * max(vehicle.speed, least)


def _near_entry(sources: int):
    @entry_point
    def run(episodes, vehicles, people, road, options, seconds, near, first, end):
        least = options[0].target_speeds[1]
        for row in range(first, end):
            ego = episodes[row].controlled[0]
            near[row] = False
            if ego < 0:
                continue
            for person in people[row]:
                if person.state == MOVING:
                    near[row] |= _is_near(vehicles[row, ego], person, road, seconds, least)
        return sources

    return run


near: Any = _near_entry(fingerprint(__file__))
"""Write whether each ego reaches a person who comes into its lane within some seconds, (row,)."""


@allocating_kernel
def observe(people, agent, sight, turn, settings, observation):
    """Write the rows of the nearest people of each class, behind the vehicles', by distance.

    Args:
        people: PERSON records of the episode.
        agent: Record of the vehicle of the agent that observes.
        sight: SIGHT record with the scales.
        turn: Cosine and sine of the frame's turn, from east to north.
        settings: SETTINGS record.
        observation: Rows of the observation, which are written.
    """
    first = settings.vehicle_rows
    numbers = np.empty(len(people), np.int64)
    distances = np.empty(len(people))
    begin = 0
    for kind in range(MOST_CLASSES):
        visible = 0
        rows = settings.classes[kind].rows
        end = begin + settings.classes[kind].persons
        for number in range(begin, end):
            person = people[number]
            if person.state == ABSENT or person.state == GONE:
                continue
            apart = distance(person.x, person.y, agent.x, agent.y)
            rewards.insert(numbers, distances, visible, number, apart, 0.0)
            visible += 1
        for place in range(min(visible, rows)):
            row = observation[first + place]
            rewards.write_row(people[numbers[place]], 0.0, 0.0, 0.0, 0.0, sight, turn, row)
            row[0] = FIRST_CODE + kind
        first += rows
        begin = end
