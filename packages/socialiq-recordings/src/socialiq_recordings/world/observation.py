"""Observation, contacts and rewards of the ego, compiled.

Rows have the intersection's seven numbers, in a frame that follows the ego's route: y to the south
is the distance along the route to the first conflict area, x to the east the distance to the right
of the route. The ego's route is therefore a straight line for every ego, and what a policy sees
tells where others are with respect to it.
"""

import math

import numpy as np

from socialiq.physics import overlap_depth
from socialiq.worlds.highway.core import rewards
from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.core.vehicle import clip, who_struck
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.intersection.options import POSITION_RANGE, SPEED_RANGE
from socialiq_recordings.world.geometry import projected
from socialiq_recordings.world.people import NO_PERSON, people_of, person_at
from socialiq_recordings.world.traffic import DT, ahead_of, closed_line, count_of, pair_of

_FAR = 100.0  # m; vehicles whose way has nothing to do with the ego's come after the others
_UNTOUCHED = int(Contact.NONE)


@kernel
def _write(row, along, left, turned, speed):
    """Write one road user; x to the right of the route, y backwards along it."""
    row[0] = 1.0
    row[1] = clip(-left / POSITION_RANGE, -1.0, 1.0)
    row[2] = clip(-along / POSITION_RANGE, -1.0, 1.0)
    east = -math.sin(turned)
    south = -math.cos(turned)
    row[3] = clip(speed * east / SPEED_RANGE, -1.0, 1.0)
    row[4] = clip(speed * south / SPEED_RANGE, -1.0, 1.0)
    row[5] = east
    row[6] = south


@kernel
def _write_beside(road, ego, user, row):
    """Write a road user by its place beside the ego's way."""
    along, left, way = projected(road, ego.way, user.x, user.y)
    _write(row, along - road.origin[ego.way], left, user.heading - way, user.speed)


@inlined_kernel
def observe(road, episode, vehicles, observation):
    """Write the ego, the closed line ahead as a standing vehicle, then other road users.

    These are ordered by distance: first people, which are written as vehicles are, and vehicles
    whose ways meet the ego's or lie in it, then all other vehicles.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        vehicles: VEHICLE records of the episode.
        observation: Rows of seven numbers that are written; rows without a road user are 0.
    """
    observation[:] = 0.0
    ego = vehicles[episode.controlled[0]]
    origin = road.origin[ego.way]
    _write(observation[0], ego.along - origin, 0.0, 0.0, ego.speed)
    filled = 1
    line = closed_line(road, ego.way, ego.along + 0.5 * ego.length, episode.sub_steps * DT)
    if line - ego.along < POSITION_RANGE:
        _write(observation[1], line - origin, 0.0, 0.0, 0.0)
        filled = 2
    persons = people_of(road, episode)
    most = count_of(road, episode) + len(persons)
    slots = np.empty(most, np.int64)
    ranks = np.empty(most)
    near = 0
    for slot in range(episode.vehicles):
        car = vehicles[vehicles[slot].present]
        apart = math.hypot(car.x - ego.x, car.y - ego.y)
        if car.identity == ego.identity or apart >= POSITION_RANGE:
            continue
        pair = pair_of(road, episode, ego, car)
        back = pair_of(road, episode, car, ego)
        meets = road.area_of[pair] >= 0 or road.stretch_first[pair + 1] > road.stretch_first[pair]
        meets = meets or road.stretch_first[back + 1] > road.stretch_first[back]
        rank = apart if meets else apart + _FAR
        rewards.insert(slots, ranks, near, car.identity, rank, 0.0)
        near += 1
    for number in persons:
        person = person_at(road, number, episode.sub_steps)
        apart = math.hypot(person.x - ego.x, person.y - ego.y)
        if person.present and apart < POSITION_RANGE:
            rewards.insert(slots, ranks, near, -1 - number, apart, 0.0)
            near += 1
    for slot in range(min(near, len(observation) - filled)):
        number = slots[slot]
        row = observation[filled + slot]
        if number >= 0:
            _write_beside(road, ego, vehicles[number], row)
        else:
            person = person_at(road, -1 - number, episode.sub_steps)
            _write_beside(road, ego, person, row)


@kernel
def _overlap(car, user, slack, their_slack):
    """Whether a vehicle and a road user overlap, each narrower and shorter by a slack, m."""
    length = max(car.length - slack, 0.1) / 2
    width = max(car.width - slack, 0.1) / 2
    half = max(user.length - their_slack, 0.1) / 2
    side = max(user.width - their_slack, 0.1) / 2
    dx = user.x - car.x
    dy = user.y - car.y
    if dx * dx + dy * dy >= (length + width + half + side) ** 2:
        return False
    depth = overlap_depth(dx, dy, car.heading, user.heading, length, width, half, side)
    return depth > 0.0


@kernel
def person_met(road, episode, car, slack):
    """Return the first person that overlaps a vehicle, a `Person`; `NO_PERSON` if there is none.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        car: Record of the vehicle.
        slack: Length by which the vehicle is narrower and shorter than recorded, m.
    """
    for number in people_of(road, episode):
        person = person_at(road, number, episode.sub_steps)
        if person.present and _overlap(car, person, slack, 0.0):
            return person
    return NO_PERSON


@inlined_kernel
def touched(road, episode, vehicles, slack):
    """Return the ego's contact: whose motion closed the gap between the centres.

    The contact is that with the first vehicle on the road that the ego overlaps, whose identity is
    written to `touched`; else with a person, whose class is written to `hit`.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        vehicles: VEHICLE records of the episode.
        slack: Length by which vehicles are narrower and shorter than recorded, m.

    Returns:
        A `Contact` as an integer.
    """
    ego = vehicles[episode.controlled[0]]
    episode.touched[0] = ego.identity
    for slot in range(episode.vehicles):
        car = vehicles[vehicles[slot].present]
        if car.identity != ego.identity and _overlap(ego, car, slack, slack):
            episode.touched[0] = car.identity
            return who_struck(ego, car)
    person = person_met(road, episode, ego, slack)
    if not person.present:
        return _UNTOUCHED
    episode.hit = person.kind
    return who_struck(ego, person)


@inlined_kernel
def others_touched(road, episode, vehicles, slack):
    """Count the vehicles, without the ego, that touch something for the first time.

    They are marked in their records.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        vehicles: VEHICLE records of the episode.
        slack: Length by which vehicles are narrower and shorter than recorded, m.

    Returns:
        The number of vehicles that drive into each other, and of those that touch a person.
    """
    ego = episode.controlled[0]
    collided = 0
    hits = 0
    for slot in range(episode.vehicles):
        car = vehicles[vehicles[slot].present]
        if car.identity == ego:
            continue
        for later in range(slot + 1, episode.vehicles):
            partner = vehicles[vehicles[later].present]
            is_new = not (car.touched and partner.touched)
            if partner.identity != ego and is_new and _overlap(car, partner, slack, slack):
                collided += 2 - car.touched - partner.touched
                car.touched = partner.touched = True
        if not car.met and person_met(road, episode, car, slack).present:
            car.met = True
            hits += 1
    return collided, hits


@inlined_kernel
def annotate(road, episode, vehicles, progress, ending, settings, results, at):
    """Write signals and rewards of a decision.

    The ending OTHER, past a closed line, costs as a collision. A neighbour counts in Eq 4.2 if it
    is near and the ego may be its reason to brake: its way meets the ego's and neither has left the
    conflict area, or the ego is ahead on its way.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record, after the decision.
        vehicles: VEHICLE records of the episode; `before` has the speeds before the decision.
        progress: Distance by which the ego advanced, m.
        ending: Ending of the decision, an `Ending` as an integer.
        settings: SETTINGS record of the world.
        results: Buffers whose `signals`, `rewards` and `braking` are written.
        at: Row of the buffers.
    """
    ego = vehicles[episode.controlled[0]]
    count = count_of(road, episode)
    counted = np.zeros(count, np.bool_)
    lost = np.zeros(count)
    for slot in range(episode.vehicles):
        car = vehicles[vehicles[slot].present]
        if car.identity == ego.identity:
            continue
        blocks = False
        area = road.area_of[pair_of(road, episode, ego, car)]
        if area >= 0:
            left = ego.along - 0.5 * ego.length >= road.area[area, 1]
            they_left = car.along - 0.5 * car.length >= road.area[area, 3]
            blocks = not left and not they_left
        ahead = ahead_of(road, pair_of(road, episode, car, ego), ego.along, car.along)
        near = math.hypot(car.x - ego.x, car.y - ego.y) <= settings.conflict_distance
        counted[car.identity] = near and (blocks or ahead > car.along)
        lost[car.identity] = car.before - car.speed
    signals = results.signals[at]
    rewards.env_signals(progress, True, ego.speed, ending, settings, signals)
    within = road.zone[ego.way, 0] <= ego.along <= road.zone[ego.way, 1]
    braking = np.empty(count, np.bool_)
    rewards.social_signals(ego.speed, within, counted, lost, ending, settings, signals, braking)
    for number in range(min(count, results.braking.shape[1])):
        results.braking[at, number] = braking[number]
        vehicles[number].counted = counted[number]
    r_env, r_social = rewards.pair(signals, settings)
    results.rewards[at, 0] = r_env
    results.rewards[at, 1] = r_social
