"""Observation and rewards of the ego, compiled.

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
from socialiq.worlds.highway.core.vehicle import clip
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.intersection.options import POSITION_RANGE, SPEED_RANGE
from socialiq_recordings.world.geometry import place_of, projected
from socialiq_recordings.world.people import state_at
from socialiq_recordings.world.traffic import DT, ahead_of, closed_line

_FAR = 100.0  # m; vehicles whose way has nothing to do with the ego's come after the others
_UNTOUCHED, _STRUCK, _WAS_STRUCK = (int(kind) for kind in Contact)


@kernel
def _write(row, along, left, turned, speed):
    """Write one vehicle; x to the right of the route, y backwards along it."""
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
def _insert(slots, ranks, count, slot, rank):
    """Insert a slot into `count` slots sorted by rank, behind those of the same rank."""
    at = count
    while at > 0 and ranks[at - 1] > rank:
        slots[at] = slots[at - 1]
        ranks[at] = ranks[at - 1]
        at -= 1
    slots[at] = slot
    ranks[at] = rank


@inlined_kernel
def observe(road, traffic, row, base, count, observation):
    """Write the ego, the closed line ahead as a standing vehicle, then other road users.

    These are ordered by distance: first people, which are written as vehicles are, and vehicles
    whose ways meet the ego's or lie in it, then all other vehicles.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`.
        row: Episode.
        base: First vehicle of its recording.
        count: Number of vehicles of its recording.
        observation: Rows of seven numbers that are written; rows without a road user are 0.
    """
    observation[:] = 0.0
    ego = traffic.ego[row]
    now = traffic.step[row] * DT
    vehicle = base + ego
    ego_along = traffic.along[row, ego]
    origin = road.origin[vehicle]
    pairs = road.pair_first[traffic.recording[row]]
    _write(observation[0], ego_along - origin, 0.0, 0.0, traffic.speed[row, ego])
    filled = 1
    front = ego_along + 0.5 * road.length[vehicle]
    line = closed_line(road.closed_first, road.closed, vehicle, front, now)
    if line - ego_along < POSITION_RANGE:
        _write(observation[1], line - origin, 0.0, 0.0, 0.0)
        filled = 2
    x, y, _ = place_of(road.line_first, road.line, vehicle, ego_along)
    recording = traffic.recording[row]
    first = road.person_first[recording]
    people = road.person_first[recording + 1]
    most = count + people - first
    slots = np.empty(most, np.int64)
    ranks = np.empty(most)
    near = 0
    for slot in range(traffic.n_present[row]):
        number = traffic.present[row, slot]
        if number == ego:
            continue
        along = traffic.along[row, number]
        ox, oy, _ = place_of(road.line_first, road.line, base + number, along)
        apart = math.hypot(ox - x, oy - y)
        if apart >= POSITION_RANGE:
            continue
        pair = pairs + ego * count + number
        back = pairs + number * count + ego
        meets = road.area_of[pair] >= 0 or road.stretch_first[pair + 1] > road.stretch_first[pair]
        meets = meets or road.stretch_first[back + 1] > road.stretch_first[back]
        _insert(slots, ranks, near, number, apart if meets else apart + _FAR)
        near += 1
    for person in range(first, people):
        at = state_at(road, person, traffic.step[row])
        if at >= 0:
            apart = math.hypot(road.person_state[at, 0] - x, road.person_state[at, 1] - y)
            if apart < POSITION_RANGE:
                _insert(slots, ranks, near, -1 - at, apart)
                near += 1
    for slot in range(min(near, len(observation) - filled)):
        number = slots[slot]
        if number >= 0:
            along = traffic.along[row, number]
            ox, oy, angle = place_of(road.line_first, road.line, base + number, along)
            speed = traffic.speed[row, number]
        else:
            state = road.person_state[-1 - number]
            ox = state[0]
            oy = state[1]
            angle = state[2]
            speed = state[3]
        along, left, way = projected(road.line_first, road.line, vehicle, ox, oy)
        _write(observation[filled + slot], along - origin, left, angle - way, speed)


@kernel
def overlap(road, vehicle, along, second, second_along, slack):
    """Whether two vehicles overlap, and how far each heads for its partner's middle.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        vehicle: One vehicle, numbered over all recordings.
        along: Coordinate of its middle on its way, m.
        second: The second vehicle.
        second_along: Coordinate of its middle on its way, m.
        slack: Length by which vehicles are narrower and shorter than recorded, m.

    Returns:
        Whether they overlap; and the vector from the first middle to the second, projected on the
        heading of the first vehicle and on that of the second, m. The first drives towards its
        partner if its number is positive, the second if its number is negative. Both are 0 if they
        are far apart.
    """
    x, y, angle = place_of(road.line_first, road.line, vehicle, along)
    ox, oy, turned = place_of(road.line_first, road.line, second, second_along)
    length = max(road.length[vehicle] - slack, 0.1) / 2
    width = max(road.width[vehicle] - slack, 0.1) / 2
    half = max(road.length[second] - slack, 0.1) / 2
    side = max(road.width[second] - slack, 0.1) / 2
    dx = ox - x
    dy = oy - y
    if dx * dx + dy * dy >= (length + width + half + side) ** 2:
        return False, 0.0, 0.0
    depth = overlap_depth(dx, dy, angle, turned, length, width, half, side)
    approach = math.cos(angle) * dx + math.sin(angle) * dy
    return depth > 0.0, approach, math.cos(turned) * dx + math.sin(turned) * dy


@inlined_kernel
def touched(road, traffic, row, base, slack):
    """Return the ego's contact with a vehicle: whose motion closed the gap between the centres.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`.
        row: Episode.
        base: First vehicle of its recording.
        slack: Length by which vehicles are narrower and shorter than recorded, m.

    Returns:
        A `Contact` as an integer; that of the first vehicle on the road that the ego overlaps.
    """
    ego = traffic.ego[row]
    contact = _UNTOUCHED
    for slot in range(traffic.n_present[row]):
        number = traffic.present[row, slot]
        if number == ego:
            continue
        along = traffic.along[row, ego]
        there = traffic.along[row, number]
        meet, approach, closing = overlap(road, base + ego, along, base + number, there, slack)
        if meet:
            approach = traffic.speed[row, ego] * approach
            closing = traffic.speed[row, number] * closing
            contact = _STRUCK if approach >= -closing else _WAS_STRUCK
            break
    return contact


@inlined_kernel
def others_touched(road, traffic, row, base, slack):
    """Count the vehicles, without the ego, that drive into each other for the first time.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`, in whose `touched` the vehicles are marked.
        row: Episode.
        base: First vehicle of its recording.
        slack: Length by which vehicles are narrower and shorter than recorded, m.
    """
    ego = traffic.ego[row]
    count = 0
    for slot in range(traffic.n_present[row]):
        number = traffic.present[row, slot]
        for later in range(slot + 1, traffic.n_present[row]):
            partner = traffic.present[row, later]
            is_new = not (traffic.touched[row, number] and traffic.touched[row, partner])
            if number == ego or partner == ego or not is_new:
                continue
            along = traffic.along[row, number]
            there = traffic.along[row, partner]
            if overlap(road, base + number, along, base + partner, there, slack)[0]:
                count += 2 - traffic.touched[row, number] - traffic.touched[row, partner]
                traffic.touched[row, number] = traffic.touched[row, partner] = 1
    return count


@inlined_kernel
def annotate(road, traffic, row, base, count, progress, ending, settings, results, at):
    """Write signals and rewards of a decision.

    The ending OTHER, past a closed line, costs as a collision. A neighbour counts in Eq 4.2 if it
    is near and the ego may be its reason to brake: its way meets the ego's and neither has left the
    conflict area, or the ego is ahead on its way.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`, after the decision; `before` has the speeds before it.
        row: Episode.
        base: First vehicle of its recording.
        count: Number of vehicles of its recording.
        progress: Distance by which the ego advanced, m.
        ending: Ending of the decision, an `Ending` as an integer.
        settings: SETTINGS record of the world.
        results: Buffers whose `signals` and `rewards` are written.
        at: Row of the buffers.
    """
    ego = traffic.ego[row]
    vehicle = base + ego
    ego_along = traffic.along[row, ego]
    speed = traffic.speed[row, ego]
    x, y, _ = place_of(road.line_first, road.line, vehicle, ego_along)
    pairs = road.pair_first[traffic.recording[row]]
    counted = np.zeros(count, np.bool_)
    lost = np.zeros(count)
    for slot in range(traffic.n_present[row]):
        number = traffic.present[row, slot]
        if number == ego:
            continue
        along = traffic.along[row, number]
        blocks = False
        area = road.area_of[pairs + ego * count + number]
        back = pairs + number * count + ego
        if area >= 0:
            left = ego_along - 0.5 * road.length[vehicle] >= road.area[area, 1]
            they_left = along - 0.5 * road.length[base + number] >= road.area[area, 3]
            blocks = not left and not they_left
        ahead = ahead_of(road.stretch_first, road.stretch, back, ego_along, along)
        ox, oy, _ = place_of(road.line_first, road.line, base + number, along)
        near = math.hypot(ox - x, oy - y) <= settings.conflict_distance
        counted[number] = near and (blocks or ahead > along)
        lost[number] = traffic.before[row, number] - traffic.speed[row, number]
    signals = results.signals[at]
    pair = results.rewards[at]
    rewards.env_signals(progress, True, speed, ending, settings, signals)
    within = road.zone[vehicle, 0] <= ego_along <= road.zone[vehicle, 1]
    braking = np.empty(count, np.bool_)
    rewards.social_signals(speed, within, counted, lost, ending, settings, signals, braking)
    if results.braking.shape[1]:
        for number in range(count):
            results.braking[at, number] = braking[number]
            results.after[at, number].counted = counted[number]
    pair[0], pair[1] = rewards.pair(signals, settings)
