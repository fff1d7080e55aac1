"""Entry and removal of vehicles: start of an episode, spawns, the ego, clearing."""

from __future__ import annotations

import math

from socialiq.worlds.highway.core import stream
from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import (
    VEHICLE_LENGTH,
    distance,
    heading_at,
    longitudinal,
    position,
)
from socialiq.worlds.highway.core.vehicle import speed_index
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.highway.state import Contact
from socialiq.worlds.intersection.core.geometry import LANES, SPEED_LIMIT, closest_lane

INITIAL_PROBABILITY = 0.6  # of each spawn before the episode, whatever spawn_probability is
ENTRY_SPEED = 8.0  # m/s, mean
SPAWN_DISTANCE = 15.0  # m that must be free
EGO_DISTANCE = 20.0  # m cleared around the ego
CHALLENGER_AT = 60.0  # m along its approach, as for the ego

_NO_CONTACT = int(Contact.NONE)


@kernel
def spawn(episode, vehicles, along, position_spread, speed_spread, probability, straight, settings):
    """Spawn a vehicle with a probability. Draws in highway-env's order, also unused values.

    Args:
        episode: EPISODE record; its stream, its count of vehicles and identities change.
        vehicles: VEHICLE records.
        along: Metres along the approach, before 5 m and the spread are added.
        position_spread: Standard deviation of the place, m.
        speed_spread: Standard deviation of the speed, m/s.
        probability: Probability of an attempt.
        straight: Whether the vehicle must go straight on.
        settings: SETTINGS record.
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
    vehicle.steering = 0.0
    vehicle.acceleration = 0.0
    vehicle.target_speed = speed
    vehicle.desired_speed = math.inf
    vehicle.time_headway = 0.0
    vehicle.jam_distance = 0.0
    vehicle.max_acceleration = 0.0
    vehicle.comfort_deceleration = 0.0
    vehicle.exponent = 0.0
    vehicle.push_x = 0.0
    vehicle.push_y = 0.0
    vehicle.identity = episode.next_identity
    vehicle.lane = closest_lane(x, y, heading, 5 * origin, tie)
    vehicle.target_lane = vehicle.lane
    vehicle.origin = origin
    vehicle.destination = destination
    vehicle.leg = 0
    vehicle.yielding = False
    vehicle.crashed = False
    vehicle.pushed = False
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


@inlined_kernel
def fill(episode, vehicles, settings):
    """Try to spawn the initial vehicles before the warm-up, along 80 m of the approaches."""
    tries = settings.initial_vehicle_count - 1
    for number in range(tries):
        along = number * (80.0 / tries)
        spawn(episode, vehicles, along, 1.0, 1.0, INITIAL_PROBABILITY, False, settings)


@inlined_kernel
def enter_ego(episode, vehicles, settings):
    """After the warm-up, add a vehicle near the junction and the ego, and clear space around it."""
    spawn(episode, vehicles, CHALLENGER_AT, 0.1, 0.0, 1.0, True, settings)
    destination = settings.destination
    if destination == 0:
        destination = 1 + stream.up_to(episode, 2)
    lane = LANES[0]
    x, y = position(lane, 60.0 + 5.0 * (1.0 + stream.normal(episode)))
    episode.ego = episode.vehicles
    heading = heading_at(lane, 60.0)
    ego = _enter(episode, vehicles, x, y, heading, SPEED_LIMIT, 0, destination, settings.tie)
    if not settings.continuous:
        ego.target_speed = settings.target_speeds[speed_index(SPEED_LIMIT, settings)]
    episode.contact = _NO_CONTACT
    episode.touched = -1
    count = 0
    for slot in range(episode.vehicles):
        vehicle = vehicles[slot]
        crowding = distance(vehicle.x, vehicle.y, x, y) < EGO_DISTANCE
        if slot == episode.ego or not crowding:
            _move_slot(episode, vehicles, slot, count)
            count += 1
    episode.vehicles = count


@inlined_kernel
def clear(episode, vehicles):
    """Remove the vehicles in the last 20 m of an exit, never the ego."""
    count = 0
    for slot in range(episode.vehicles):
        if slot == episode.ego or not _is_leaving(vehicles[slot]):
            _move_slot(episode, vehicles, slot, count)
            count += 1
    episode.vehicles = count


@kernel
def _is_leaving(vehicle):
    if vehicle.lane % 5 != EXIT:
        return False
    lane = LANES[vehicle.lane]
    return longitudinal(lane, vehicle.x, vehicle.y) >= lane.length - 4 * VEHICLE_LENGTH


@kernel
def _move_slot(episode, vehicles, slot, place):
    if place == slot:
        return
    vehicles[place] = vehicles[slot]
    if slot == episode.ego:
        episode.ego = place
