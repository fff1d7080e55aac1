"""Traffic of any road: vehicles enter, drive a sub-step, arrive later, and leave."""

import math

from socialiq.worlds.highway.core import drivers, priority, stream
from socialiq.worlds.highway.core import vehicle as motion
from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import (
    VEHICLE_LENGTH,
    closest_lane,
    distance,
    heading_at,
    longitudinal,
    position,
)
from socialiq.worlds.highway.core.people import brake, clear, schedule, walk
from socialiq.worlds.highway.network import CONFLICT, EXIT
from socialiq.worlds.highway.options import EXPONENT
from socialiq.worlds.highway.scenes import NORMAL, UNIFORM

INITIAL_PROBABILITY = 0.6  # of each spawn before the episode, whatever spawn_probability is
ENTRY_SPEED = 8.0  # m/s, mean
SPAWN_DISTANCE = 15.0  # m that must be free
AGENT_DISTANCE = 20.0  # m cleared around an agent
AGENT_AT = CHALLENGER_AT = 60.0  # m along the approach
AGENTS_APART = 20.0  # m between agents of one approach
_FAR = 1e6  # m, where removed vehicles of a road without arrivals stand


@kernel
def sub_step(episode, vehicles, people, influences, road, settings):
    """Advance all by a sub-step: decisions, rules of priority if due, motion, then collisions.

    Args:
        episode: EPISODE record.
        vehicles: Records of the vehicles and obstacles of the episode.
        people: PERSON records of the episode.
        influences: INFLUENCE records of each agent and person, which are written.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    count = episode.vehicles
    records = count + len(road.obstacles)
    for slot in range(count):
        if vehicles[slot].agent < 0:
            drivers.drive(vehicles, records, slot, road, settings)
        elif not settings.continuous:  # else the record holds the command
            drivers.control(vehicles[slot], road)
    if len(people):
        brake(vehicles, count, people, road)
    episode.sub_steps += 1
    if settings.rule_period and episode.sub_steps % settings.rule_period == 0:
        priority.enforce(vehicles, count, road, settings)
    for slot in range(count):
        car = vehicles[slot]
        car.timer += settings.dt
        motion.advance(car, settings.dt)
        car.lane = closest_lane(road.lanes, car.x, car.y, car.heading, car.lane, settings.tie)
        if settings.continuous and car.agent >= 0:  # it is steered along no lane
            if not road.sight[0].by_route:
                car.target_lane = car.lane
            else:
                _count_road(car, road.routes[car.route, car.destination], road.lanes)
    motion.collide(episode, vehicles, records, settings.agents, settings.dt, settings.tie)
    if len(people):
        walk(episode, vehicles, people, influences, road, settings)


@kernel
def _count_road(car, way, lanes):
    """Count the roads that a steered agent has completed, if its way leads along a circle."""
    following = car.leg + 1
    along_circle = len(way) > 3 and way[2] >= 0 and lanes[way[2]].kind == CONFLICT
    if along_circle and following < len(way) and way[following] == car.lane:
        car.leg = following


@kernel
def reset(episode, vehicles, people, influences, road, settings):
    """Start an episode from the current state of the stream.

    The road's entries begin with it, in highway-env's order. Where others arrive, vehicles spawn
    along 80 m of the approaches and drive on; then another enters near the junction, and the
    agents, around which space is cleared. Elsewhere agents are the first entries.

    Args:
        episode: EPISODE record, which holds the stream.
        vehicles: Records that are written, vehicles first, then obstacles.
        people: PERSON records that are written.
        influences: INFLUENCE records of each agent and person.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    episode.time = 0.0
    episode.sub_steps = 0
    episode.vehicles = 0
    episode.next_identity = 0
    clear(people)
    for number in range(len(road.entries)):
        _enter_by(episode, vehicles, road.entries[number], road, settings)
    for number in range(len(road.obstacles)):
        obstacle = vehicles[episode.vehicles + number]
        x = road.obstacles[number, 0]
        y = road.obstacles[number, 1]
        _stand(episode, obstacle, x, y, 0.0, 0.0, road, settings)
        obstacle.obstacle = True
    if len(road.arrivals):
        tries = settings.initial_vehicle_count - 1
        for number in range(tries):
            along = number * (80.0 / tries)
            _spawn(episode, vehicles, along, 1.0, 1.0, INITIAL_PROBABILITY, False, road, settings)
        for _ in range(settings.warm_up):
            sub_step(episode, vehicles, people, influences, road, settings)
        _spawn(episode, vehicles, CHALLENGER_AT, 0.1, 0.0, 1.0, True, road, settings)
        for number in range(settings.agents):
            _enter_agent(episode, vehicles, number, road, settings)
    else:
        for number in range(settings.agents):
            agent = vehicles[number]
            agent.agent = number
            agent.exponent = EXPONENT
            episode.controlled[number] = number
            agent.target_speed = 0.0  # what drivers assume of an agent without one
            if not settings.continuous:
                level = motion.speed_index(agent.speed, settings)
                agent.target_speed = settings.target_speeds[level]
    schedule(episode, people, road, settings)


@kernel
def _stand(episode, vehicle, x, y, heading, speed, road, settings):
    """Write a vehicle or obstacle that has entered, without a driver and a way."""
    vehicle.x = x
    vehicle.y = y
    vehicle.heading = heading
    vehicle.speed = speed
    vehicle.along_x = math.cos(heading)
    vehicle.along_y = math.sin(heading)
    vehicle.steering = 0.0
    vehicle.acceleration = 0.0
    vehicle.target_speed = speed
    vehicle.desired_speed = math.inf
    vehicle.time_headway = 0.0
    vehicle.jam_distance = 0.0
    vehicle.max_acceleration = 0.0
    vehicle.comfort_deceleration = 0.0
    vehicle.exponent = 0.0
    vehicle.timer = 0.0
    vehicle.push_x = 0.0
    vehicle.push_y = 0.0
    vehicle.identity = episode.next_identity
    vehicle.lane = closest_lane(road.lanes, x, y, heading, 0, settings.tie)
    vehicle.target_lane = vehicle.lane
    vehicle.origin = -1
    vehicle.route = -1
    vehicle.destination = 0
    vehicle.leg = 0
    vehicle.changes = False
    vehicle.yielding = False
    vehicle.obstacle = False
    vehicle.agent = -1
    vehicle.crashed = False
    vehicle.pushed = False
    episode.next_identity += 1


@kernel
def _enter(episode, vehicles, x, y, heading, speed, road, settings):
    """Fill the next free slot, before the obstacles."""
    obstacles = len(road.obstacles)
    for slot in range(episode.vehicles + obstacles, episode.vehicles, -1):
        vehicles[slot] = vehicles[slot - 1]
    vehicle = vehicles[episode.vehicles]
    _stand(episode, vehicle, x, y, heading, speed, road, settings)
    episode.vehicles += 1
    return vehicle


@kernel
def _enter_by(episode, vehicles, entry, road, settings):
    """Let a vehicle of the road's table enter.

    Draws in highway-env's order: lane, place, speed, destination, driver.
    """
    number = entry.lane + 0
    if entry.lanes > 1:
        number += stream.up_to(episode, entry.lanes - 1)
    lane = road.lanes[number]
    along = entry.along + _spread(episode, entry.spread, entry.along_spread)
    speed = entry.speed + _spread(episode, entry.spread, entry.speed_spread)
    x, y = position(lane, along)
    vehicle = vehicles[episode.vehicles]
    _stand(episode, vehicle, x, y, heading_at(lane, along), speed, road, settings)
    episode.vehicles += 1
    vehicle.changes = entry.changes
    vehicle.origin = road.lanes[entry.lane].road
    if entry.target_speed > 0:
        vehicle.target_speed = entry.target_speed
    sight = road.sight[0]
    vehicle.timer = ((x * sight.side_x + y * sight.side_y) * math.pi) % drivers.CHANGE_EVERY
    if entry.destination >= 0:
        vehicle.route = road.lanes[vehicle.lane].road
        vehicle.destination = entry.destination + stream.up_to(episode, entry.destinations - 1)
    draw_driver(episode, vehicle, entry.exponent, settings)


@kernel
def _spread(episode, kind, size):
    if kind == UNIFORM:
        return -size + (size - -size) * stream.uniform(episode)
    if kind == NORMAL:
        return stream.normal(episode) * size
    return 0.0


@kernel
def _spawn(
    episode, vehicles, along, position_spread, speed_spread, probability, straight, road, settings
):
    """Spawn a vehicle with a probability. Draws in highway-env's order, also unused values.

    `along` is the coordinate along its approach, m, before 5 m and the spread are added; spreads
    are standard deviations, m and m/s. With `straight` the vehicle goes straight on.
    """
    if stream.uniform(episode) > probability:
        return
    arms = len(road.arrivals)
    origin, destination = stream.two_of(episode, arms)
    if straight:
        destination = (origin + arms // 2) % arms
    lane = road.lanes[road.arrivals[origin, destination]]
    along = along + 5.0 + stream.normal(episode) * position_spread
    x, y = position(lane, along)
    speed = ENTRY_SPEED + stream.normal(episode) * speed_spread
    for slot in range(episode.vehicles):
        if distance(vehicles[slot].x, vehicles[slot].y, x, y) < SPAWN_DISTANCE:
            return
    vehicle = _enter(episode, vehicles, x, y, heading_at(lane, along), speed, road, settings)
    vehicle.origin = origin
    vehicle.route = lane.road
    vehicle.destination = destination
    draw_driver(episode, vehicle, True, settings)


@kernel
def draw_driver(episode, vehicle, draws_exponent, settings):
    """Draw the parameters that the population varies, in the order of its fields.

    Args:
        episode: EPISODE record, which holds the stream.
        vehicle: Record of the driver's vehicle, which is written.
        draws_exponent: Whether the exponent is drawn too, before the others.
        settings: SETTINGS record with the population.
    """
    vehicle.exponent = EXPONENT
    if draws_exponent:
        vehicle.exponent = 3.5 + 1.0 * stream.uniform(episode)
    vehicle.desired_speed = _draw(episode, settings.population[0])
    vehicle.time_headway = _draw(episode, settings.population[1])
    vehicle.jam_distance = _draw(episode, settings.population[2])
    vehicle.max_acceleration = _draw(episode, settings.population[3])
    vehicle.comfort_deceleration = _draw(episode, settings.population[4])
    if vehicle.desired_speed < math.inf:
        vehicle.target_speed = vehicle.desired_speed


@kernel
def _draw(episode, field):
    mean = field[0]
    deviation = field[1]
    if deviation == 0:
        return mean
    value = mean + deviation * stream.normal(episode)
    return min(max(value, field[2]), field[3])


@kernel
def _enter_agent(episode, vehicles, number, road, settings):
    """Let an agent enter, on the arms in turn and then further back; clear space."""
    arms = len(road.arrivals)
    arm = number % arms
    row = number // arms
    destination = settings.destination
    if destination == 0:
        destination = 1 + stream.up_to(episode, arms - 2)
    if settings.own_frame:
        destination = (arm + destination) % arms
    lane = road.lanes[road.arrivals[arm, destination]]
    along = AGENT_AT - AGENTS_APART * row + 5.0 * (1.0 + stream.normal(episode))
    x, y = position(lane, along)
    slot = episode.vehicles
    speed = lane.speed_limit
    heading = heading_at(lane, AGENT_AT)
    agent = _enter(episode, vehicles, x, y, heading, speed, road, settings)
    agent.origin = arm
    agent.route = lane.road
    agent.destination = destination
    agent.agent = number
    episode.controlled[number] = slot
    if not settings.continuous:
        agent.target_speed = settings.target_speeds[motion.speed_index(speed, settings)]
    for slot in range(episode.vehicles - 1, -1, -1):
        vehicle = vehicles[slot]
        crowding = distance(vehicle.x, vehicle.y, x, y) < AGENT_DISTANCE
        if vehicle.agent < 0 and crowding:
            remove(episode, vehicles, slot, road)


@kernel
def leaves(vehicle, lane, renews):
    """Whether a vehicle leaves after a decision: it is in the last 20 m of an exit.

    Args:
        vehicle: Record of the vehicle.
        lane: Record of its lane.
        renews: Whether others arrive on the road; else no vehicle leaves it.
    """
    if not renews or lane.kind != EXIT:
        return False
    return longitudinal(lane, vehicle.x, vehicle.y) >= lane.length - 4 * VEHICLE_LENGTH


@kernel
def renew(episode, vehicles, road, settings):
    """Remove the vehicles that leave, never an agent, and try a spawn.

    Args:
        episode: EPISODE record, which holds the stream.
        vehicles: Records of the episode.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    if len(road.arrivals) == 0:
        return
    for slot in range(episode.vehicles - 1, -1, -1):
        if vehicles[slot].agent < 0 and leaves(
            vehicles[slot], road.lanes[vehicles[slot].lane], True
        ):
            remove(episode, vehicles, slot, road)
    _spawn(episode, vehicles, 0.0, 1.0, 1.0, settings.spawn_probability, False, road, settings)


@kernel
def remove(episode, vehicles, slot, road):
    """Take a vehicle off the road; those behind it in the list, and obstacles, move up.

    On a road without arrivals the vehicle keeps its slot, out of reach of all others.

    Args:
        episode: EPISODE record.
        vehicles: Records of the episode.
        slot: Slot of the vehicle.
        road: Tables of the road.
    """
    if vehicles[slot].agent >= 0:
        episode.controlled[vehicles[slot].agent] = -1
    if len(road.arrivals) == 0:
        _put_away(vehicles[slot], slot)
        return
    for target in range(slot, episode.vehicles + len(road.obstacles) - 1):
        vehicles[target] = vehicles[target + 1]
        if vehicles[target].agent >= 0:
            episode.controlled[vehicles[target].agent] = target
    episode.vehicles -= 1


@kernel
def _put_away(vehicle, slot):
    vehicle.x = _FAR * (2 + slot)
    vehicle.y = _FAR
    vehicle.speed = 0.0
    vehicle.target_speed = 0.0
    vehicle.steering = 0.0
    vehicle.acceleration = 0.0
    vehicle.pushed = False


@kernel
def release(episode, vehicles, road, settings):
    """Make the ego the mean driver of the population.

    Where vehicles yield, or the ego had no target speed, it takes the road's limit as that.

    Args:
        episode: EPISODE record.
        vehicles: Records of the episode.
        road: Tables of the road.
        settings: SETTINGS record.
    """
    ego = vehicles[episode.controlled[0]]
    mean = settings.population[:, 0]
    ego.exponent = EXPONENT
    ego.desired_speed = mean[0]
    ego.time_headway = mean[1]
    ego.jam_distance = mean[2]
    ego.max_acceleration = mean[3]
    ego.comfort_deceleration = mean[4]
    if settings.rule_period or settings.continuous:
        ego.target_speed = min(road.lanes[ego.lane].speed_limit, ego.desired_speed)
    ego.agent = -1
    episode.controlled[0] = -1
