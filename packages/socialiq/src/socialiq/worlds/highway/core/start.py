"""Start of an episode: vehicles enter in the order of a scene's entries."""

from __future__ import annotations

import math

from socialiq.worlds.highway.core import stream
from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.drivers import CHANGE_EVERY
from socialiq.worlds.highway.core.geometry import heading_at, position
from socialiq.worlds.highway.core.lanes import closest_lane
from socialiq.worlds.highway.core.vehicle import speed_index
from socialiq.worlds.highway.scene import NORMAL, UNIFORM
from socialiq.worlds.highway.state import Contact

_NO_CONTACT = int(Contact.NONE)

TIME_HEADWAY = 1.5  # s
JAM_DISTANCE = 10.0  # m
ACCELERATION = 3.0  # m/s²
DECELERATION = 5.0  # m/s²
EXPONENT = 4.0


@kernel
def reset(episode, cars, road, settings):
    """Start an episode from the current state of the stream."""
    episode.time = 0.0
    episode.sub_steps = 0
    episode.ego = 0
    episode.contact = _NO_CONTACT
    episode.touched = -1
    episode.vehicles = len(road.entries)
    for slot in range(len(road.entries)):
        cars[slot].identity = slot
        _enter(episode, cars[slot], road.entries[slot], road)
    ego = cars[0]
    ego.exponent = EXPONENT
    ego.target_speed = settings.target_speeds[speed_index(ego.speed, settings)]
    for number in range(len(road.obstacles)):
        slot = len(road.entries) + number
        cars[slot].identity = slot
        place = road.obstacles[number]
        _stand(cars[slot], place[0], place[1], 0.0, 0.0, road)
        cars[slot].obstacle = True


@kernel
def _enter(episode, car, entry, road):
    """Draw a vehicle's start in highway-env's order: lane, place, speed, destination, driver."""
    number = entry.lane + 0
    if entry.lanes > 1:
        number += stream.up_to(episode, entry.lanes - 1)
    lane = road.lanes[number]
    along = entry.along + _spread(episode, entry.spread, entry.along_spread)
    speed = entry.speed + _spread(episode, entry.spread, entry.speed_spread)
    x, y = position(lane, along)
    _stand(car, x, y, heading_at(lane, along), speed, road)
    car.target_speed = entry.target_speed if entry.target_speed > 0 else speed
    car.timer = ((x + y) * math.pi) % CHANGE_EVERY
    car.time_headway, car.jam_distance = TIME_HEADWAY, JAM_DISTANCE
    car.max_acceleration, car.comfort_deceleration = ACCELERATION, DECELERATION
    car.exponent = EXPONENT
    car.route, car.destination, car.leg = -1, 0, 0
    if entry.destination >= 0:
        car.route = road.lanes[car.lane].road
        car.destination = entry.destination + stream.up_to(episode, entry.destinations - 1)
    if entry.exponent:
        car.exponent = 3.5 + 1.0 * stream.uniform(episode)


@kernel
def _spread(episode, kind, size):
    if kind == UNIFORM:
        return -size + (size - -size) * stream.uniform(episode)
    if kind == NORMAL:
        return stream.normal(episode) * size
    return 0.0


@kernel
def _stand(car, x, y, heading, speed, road):
    car.x, car.y, car.heading, car.speed = x, y, heading, speed
    car.along_x, car.along_y = math.cos(heading), math.sin(heading)
    car.steering = 0.0
    car.acceleration = 0.0
    car.target_speed = speed
    car.push_x = 0.0
    car.push_y = 0.0
    car.lane = closest_lane(road.lanes, x, y, heading, 0)
    car.target_lane = car.lane
    car.obstacle = False
    car.crashed = False
    car.pushed = False
