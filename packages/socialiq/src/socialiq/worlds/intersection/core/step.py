"""The intersection's decisions: entry and removal of vehicles, sub-steps, and the entry point."""

import math
from typing import Any

from socialiq.worlds.highway.core import stream
from socialiq.worlds.highway.core.compile import entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.effects import effects_of
from socialiq.worlds.highway.core.geometry import (
    VEHICLE_LENGTH,
    distance,
    heading_at,
    longitudinal,
    position,
)
from socialiq.worlds.highway.core.step import RoadKernels, carry_out_of
from socialiq.worlds.highway.core.vehicle import advance, collide, speed_index
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.intersection.core import people, traffic
from socialiq.worlds.intersection.core.geometry import LANES, closest_lane
from socialiq.worlds.intersection.options import SIGHT, SPEED_LIMIT

INITIAL_PROBABILITY = 0.6  # of each spawn before the episode, whatever spawn_probability is
ENTRY_SPEED = 8.0  # m/s, mean
SPAWN_DISTANCE = 15.0  # m that must be free
AGENT_DISTANCE = 20.0  # m cleared around an agent
AGENT_AT = CHALLENGER_AT = 60.0  # m along the approach
AGENTS_APART = 20.0  # m between agents of one approach


@kernel
def _spawn(
    episode, vehicles, along, position_spread, speed_spread, probability, straight, settings
):
    """Spawn a vehicle with a probability. Draws in highway-env's order, also unused values.

    It is so many metres along its approach, before 5 m and the spread are added; spreads are
    standard deviations, m and m/s. It may have to go straight on.
    """
    if stream.uniform(episode) > probability:
        return
    origin, destination = stream.two_of_four(episode)
    if straight:
        destination = (origin + 2) % 4
    lane = LANES[5 * origin]
    along = along + 5.0 + stream.normal(episode) * position_spread
    x, y = position(lane, along)
    speed = ENTRY_SPEED + stream.normal(episode) * speed_spread
    for slot in range(episode.vehicles):
        if distance(vehicles[slot].x, vehicles[slot].y, x, y) < SPAWN_DISTANCE:
            return
    heading = heading_at(lane, along)
    vehicle = _enter(episode, vehicles, x, y, heading, speed, origin, destination, settings.tie)
    draw_driver(episode, vehicle, settings)


@kernel
def _enter(episode, vehicles, x, y, heading, speed, origin, destination, tie):
    """Fill the next free slot."""
    vehicle = vehicles[episode.vehicles]
    vehicle.x, vehicle.y, vehicle.heading, vehicle.speed = x, y, heading, speed
    vehicle.along_x, vehicle.along_y = math.cos(heading), math.sin(heading)
    vehicle.steering, vehicle.acceleration = 0.0, 0.0
    vehicle.target_speed, vehicle.desired_speed = speed, math.inf
    vehicle.time_headway, vehicle.jam_distance, vehicle.exponent = 0.0, 0.0, 0.0
    vehicle.max_acceleration, vehicle.comfort_deceleration = 0.0, 0.0
    vehicle.push_x, vehicle.push_y = 0.0, 0.0
    vehicle.identity = episode.next_identity
    vehicle.lane = closest_lane(x, y, heading, 5 * origin, tie)
    vehicle.target_lane = vehicle.lane
    vehicle.origin, vehicle.destination, vehicle.leg = origin, destination, 0
    vehicle.yielding, vehicle.crashed, vehicle.pushed, vehicle.agent = False, False, False, -1
    episode.vehicles += 1
    episode.next_identity += 1
    return vehicle


@kernel
def draw_driver(episode, vehicle, settings):
    """Draw the parameters that the population varies, in the order of its fields."""
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
    mean, deviation = field[0], field[1]
    if deviation == 0:
        return mean
    value = mean + deviation * stream.normal(episode)
    return min(max(value, field[2]), field[3])


@kernel
def _move_slot(episode, vehicles, slot, target):
    if target == slot:
        return
    vehicles[target] = vehicles[slot]
    if vehicles[target].agent >= 0:
        episode.controlled[vehicles[target].agent] = target


@kernel
def _sub_step(episode, vehicles, _road, settings):
    """Advance by a sub-step: decisions, road rules if due, motion, then collisions."""
    count = episode.vehicles
    for slot in range(count):
        if vehicles[slot].agent < 0:
            traffic.drive(vehicles, count, slot, settings)
            if settings.walkers:
                people.brake(vehicles, slot, settings)
        elif not settings.continuous:  # else the record holds the command
            traffic.control(vehicles[slot])
    episode.sub_steps += 1
    if episode.sub_steps % settings.rule_period == 0:
        traffic.enforce(vehicles, count, settings)
    for slot in range(count):
        car = vehicles[slot]
        advance(car, settings.dt)
        car.lane = closest_lane(car.x, car.y, car.heading, car.lane, settings.tie)
    collide(episode, vehicles, count, settings.agents, settings.dt, settings.tie)
    if settings.walkers:
        people.walk(episode, vehicles, settings)


@kernel
def _reset(episode, vehicles, road, settings):
    """Start an episode from the stream.

    Vehicles spawn along 80 m of the approaches and drive on; then another enters near the junction,
    and the agents, around which space is cleared.
    """
    episode.time, episode.sub_steps, episode.vehicles, episode.next_identity = 0.0, 0, 0, 0
    people.clear(vehicles, settings)
    tries = settings.initial_vehicle_count - 1
    for number in range(tries):
        along = number * (80.0 / tries)
        _spawn(episode, vehicles, along, 1.0, 1.0, INITIAL_PROBABILITY, False, settings)
    for _ in range(settings.warm_up):
        _sub_step(episode, vehicles, road, settings)
    _spawn(episode, vehicles, CHALLENGER_AT, 0.1, 0.0, 1.0, True, settings)
    for number in range(settings.agents):
        _enter_agent(episode, vehicles, number, settings)
    if settings.walkers:
        people.schedule(episode, vehicles, settings)


@kernel
def _enter_agent(episode, vehicles, number, settings):
    """Let an agent enter, on the arms in turn and from the fifth on further back; clear space."""
    arm, row = number % 4, number // 4
    destination = settings.destination
    if destination == 0:
        destination = 1 + stream.up_to(episode, 2)
    if settings.own_frame:
        destination = (arm + destination) % 4
    lane = LANES[5 * arm]
    along = AGENT_AT - AGENTS_APART * row + 5.0 * (1.0 + stream.normal(episode))
    x, y = position(lane, along)
    heading, slot = heading_at(lane, AGENT_AT), episode.vehicles
    agent = _enter(episode, vehicles, x, y, heading, SPEED_LIMIT, arm, destination, settings.tie)
    agent.agent, episode.controlled[number] = number, slot
    if not settings.continuous:
        agent.target_speed = settings.target_speeds[speed_index(SPEED_LIMIT, settings)]
    count = 0
    for slot in range(episode.vehicles):
        vehicle = vehicles[slot]
        crowding = distance(vehicle.x, vehicle.y, x, y) < AGENT_DISTANCE
        if vehicle.agent >= 0 or not crowding:
            _move_slot(episode, vehicles, slot, count)
            count += 1
    episode.vehicles = count


@kernel
def _leaves(vehicle, _road):
    if vehicle.lane % 5 != EXIT:
        return False
    lane = LANES[vehicle.lane]
    return longitudinal(lane, vehicle.x, vehicle.y) >= lane.length - 4 * VEHICLE_LENGTH


@kernel
def _renew(episode, vehicles, road, settings):
    """Remove the vehicles in the last 20 m of an exit, never an agent, and try a spawn."""
    count = 0
    for slot in range(episode.vehicles):
        if vehicles[slot].agent >= 0 or not _leaves(vehicles[slot], road):
            _move_slot(episode, vehicles, slot, count)
            count += 1
    episode.vehicles = count
    _spawn(episode, vehicles, 0.0, 1.0, 1.0, settings.spawn_probability, False, settings)


@kernel
def _lane(number, _road):
    return LANES[number]


@kernel
def _same_origin(vehicles, slot, ego, _road):
    return vehicles[slot].origin == vehicles[ego].origin


@kernel
def _sight(_road):
    return SIGHT[0]


@kernel
def _turns(vehicle, _road, settings):
    return vehicle.origin if settings.own_frame else 0


@kernel
def _records(count, _vehicles):
    return count


@kernel
def _release(episode, vehicles, _road, settings):
    """Make the ego the mean driver of the population."""
    ego, mean = vehicles[episode.controlled[0]], settings.population[:, 0]
    ego.exponent, ego.desired_speed, ego.time_headway, ego.jam_distance = (
        4.0,
        mean[0],
        mean[1],
        mean[2],
    )
    ego.max_acceleration, ego.comfort_deceleration = mean[3], mean[4]
    ego.target_speed = min(SPEED_LIMIT, ego.desired_speed)
    ego.agent, episode.controlled[0] = -1, -1


@kernel
def _remove(episode, vehicles, slot):
    if vehicles[slot].agent >= 0:
        episode.controlled[vehicles[slot].agent] = -1
    for following in range(slot + 1, episode.vehicles):
        _move_slot(episode, vehicles, following, following - 1)
    episode.vehicles -= 1


@kernel
def _relation(vehicle, _slot, ego, _road):
    if vehicle.origin == ego.origin:
        return 0
    return 1 if vehicle.destination == ego.destination else 2


_TABLES = _lane, traffic.route_coordinate, _same_origin, traffic.arrived, _sight, _turns
_CHANGES = traffic.choose, _sub_step, _renew, _reset
_REST = _records, _leaves, _release, _remove, _relation, people.observe
_KERNELS = RoadKernels(*_TABLES, *_CHANGES, *_REST)
_carry_out = carry_out_of(_KERNELS)
_effects = effects_of(_KERNELS)


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, road, first, end):
        for row in range(first, end):
            if seeded[row]:
                stream.seed(buffers.episodes[row], entropy[row])
            _carry_out(buffers, row, commands[row], actions, road, options[0])
        return sources

    return run


def _effects_entry(sources: int):
    @entry_point
    def run(command, buffers, ledger, rows, options, road, effects, first, end):
        for row in range(first, end):
            if rows[row]:
                _effects(command, buffers, ledger, row, road, options[0], effects[0])
        return sources

    return run


run: Any = _entry(fingerprint(__file__))
"""Carry out a command for every episode of a batch, as `highway.core.step.run`."""

effects: Any = _effects_entry(fingerprint(__file__))
"""Carry out a command of what the ego causes, as `highway.core.step.effects`."""
