"""Drivers of scenes: their entry, the Intelligent Driver Model, MOBIL, and the ego's commands."""

import math

from socialiq.worlds.highway.core import geometry, stream
from socialiq.worlds.highway.core import vehicle as motion
from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, longitudinal
from socialiq.worlds.highway.core.vehicle import MAX_ACCELERATION, clip
from socialiq.worlds.highway.scenes import FASTER, LANE_LEFT, LANE_RIGHT, NORMAL, SLOWER, UNIFORM

CHANGE_EVERY = 1.0  # s
LEAST_GAIN = 0.2  # m/s², of a lane change
MOST_IMPOSED = 2.0  # m/s², braking of the vehicle behind
LEAST_SPEED = 1.0  # m/s, to change lanes at
TIME_HEADWAY = 1.5  # s
JAM_DISTANCE = 10.0  # m
ACCELERATION = 3.0  # m/s²
DECELERATION = 5.0  # m/s²
EXPONENT = 4.0


@kernel
def reset(episode, cars, road, settings):
    """Start an episode from the current state of the stream.

    Of each vehicle are drawn, in highway-env's order: lane, place, speed, destination, driver.
    """
    episode.time, episode.sub_steps = 0.0, 0
    episode.vehicles = len(road.entries)
    for slot in range(len(road.entries)):
        car, entry = cars[slot], road.entries[slot]
        car.identity = slot
        number = entry.lane + 0
        if entry.lanes > 1:
            number += stream.up_to(episode, entry.lanes - 1)
        lane = road.lanes[number]
        along = entry.along + _spread(episode, entry.spread, entry.along_spread)
        speed = entry.speed + _spread(episode, entry.spread, entry.speed_spread)
        x, y = geometry.position(lane, along)
        _stand(car, x, y, geometry.heading_at(lane, along), speed, road)
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
    for number in range(settings.agents):
        car = cars[number]
        car.agent, car.exponent, episode.controlled[number] = number, EXPONENT, number
        car.target_speed = settings.target_speeds[motion.speed_index(car.speed, settings)]
    for number in range(len(road.obstacles)):
        obstacle = cars[len(road.entries) + number]
        obstacle.identity = len(road.entries) + number
        _stand(obstacle, road.obstacles[number, 0], road.obstacles[number, 1], 0.0, 0.0, road)
        obstacle.obstacle = True


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
    car.steering, car.acceleration, car.target_speed = 0.0, 0.0, speed
    car.push_x, car.push_y = 0.0, 0.0
    car.lane = geometry.closest_lane(road.lanes, x, y, heading, 0)
    car.target_lane = car.lane
    car.obstacle, car.crashed, car.pushed, car.agent = False, False, False, -1


@kernel
def _follow_road(car, road):
    """Select the next lane from 2.5 m before the end of the target lane."""
    lane = road.lanes[car.target_lane]
    if longitudinal(lane, car.x, car.y) > lane.length - VEHICLE_LENGTH / 2:
        car.target_lane = geometry.following(car, road)


@kernel
def _neighbours(cars, me, number, lanes):
    """Return the slots of the nearest vehicles or obstacles ahead and behind on a lane, or -1."""
    lane = lanes[number]
    here = longitudinal(lane, cars[me].x, cars[me].y)
    front, rear, ahead, behind = -1, -1, math.inf, -math.inf
    for slot in range(len(cars)):
        x, y = cars[slot].x, cars[slot].y
        if slot == me or not geometry.on_lane(lane, x, y, 1.0):
            continue
        along = longitudinal(lane, x, y)
        if here <= along <= ahead:
            front, ahead = slot, along
        if behind < along < here:
            rear, behind = slot, along
    return front, rear


@kernel
def _acceleration(cars, slot, front, exponent, lanes):
    """Return the acceleration of the Intelligent Driver Model, m/s²; 0 of none or an obstacle.

    A driver attributes the exponent of its own free-road term to others.
    """
    if slot < 0 or cars[slot].obstacle:
        return 0.0
    car = cars[slot]
    lane = lanes[car.lane]
    free = motion.free_acceleration(car, lane.speed_limit, exponent)
    return free if front < 0 else free - motion.braking_for(car, cars[front], lane)


@kernel
def drive(cars, count, me, road):
    """Set a driver's steering and acceleration for a sub-step."""
    car = cars[me]
    if car.crashed:
        return
    lanes = road.lanes
    _follow_road(car, road)
    if road.entries[me].changes:
        _change_lane(cars, count, me, lanes)
    car.steering = motion.steering(car, lanes[car.target_lane])
    front, _ = _neighbours(cars, me, car.lane, lanes)
    rate = _acceleration(cars, me, front, car.exponent, lanes)
    if car.lane != car.target_lane:
        front, _ = _neighbours(cars, me, car.target_lane, lanes)
        rate = min(rate, _acceleration(cars, me, front, car.exponent, lanes))
    car.acceleration = clip(rate, -MAX_ACCELERATION, MAX_ACCELERATION)


@kernel
def _change_lane(cars, count, me, lanes):
    """Begin a lane change, at most once a second, or give one up that another makes too.

    A change is given up if a vehicle close ahead changes to the same lane.
    """
    car = cars[me]
    lane = lanes[car.lane]
    if car.lane != car.target_lane:
        if lane.road != lanes[car.target_lane].road:
            return
        for slot in range(count):
            neighbour = cars[slot]
            same = neighbour.target_lane == car.target_lane and neighbour.lane != car.target_lane
            if slot == me or not same:
                continue
            gap = longitudinal(lane, neighbour.x, neighbour.y) - longitudinal(lane, car.x, car.y)
            if 0 < gap < motion.desired_gap(car, neighbour):
                car.target_lane = car.lane
                return
        return
    if not car.timer > CHANGE_EVERY:
        return
    car.timer = 0.0
    here = car.lane + 0
    for side in (-1, 1):
        number = lane.number + side
        if not 0 <= number < lane.lanes:
            continue
        candidate = lane.first + number
        if not geometry.reachable(lanes[candidate], car.x, car.y) or abs(car.speed) < LEAST_SPEED:
            continue
        if _worthwhile(cars, me, here, candidate, lanes):
            car.target_lane = candidate


@kernel
def _worthwhile(cars, me, here, candidate, lanes):
    """Whether MOBIL (Kesting et al. 2007) recommends a lane, without politeness."""
    car = cars[me]
    front, rear = _neighbours(cars, me, candidate, lanes)
    if _acceleration(cars, rear, me, car.exponent, lanes) < -MOST_IMPOSED:
        return False
    after = _acceleration(cars, me, front, car.exponent, lanes)
    if car.route >= 0 and car.leg == 0:  # its way prescribes the lane on which it began
        return False
    front, _ = _neighbours(cars, me, here, lanes)
    return not after - _acceleration(cars, me, front, car.exponent, lanes) < LEAST_GAIN


@kernel
def choose(car, action, road, settings):
    """Carry out an agent's action: a target lane or a target speed."""
    _follow_road(car, road)
    if action in (FASTER, SLOWER):
        level = motion.speed_index(car.speed, settings) + (1 if action == FASTER else -1)
        car.target_speed = settings.target_speeds[clip(level, 0, settings.n_speeds - 1)]
    elif action in (LANE_LEFT, LANE_RIGHT):
        lane = road.lanes[car.target_lane]
        number = lane.number + (1 if action == LANE_RIGHT else -1)
        beside = lane.first + clip(number, 0, lane.lanes - 1)
        if geometry.reachable(road.lanes[beside], car.x, car.y):
            car.target_lane = beside


@kernel
def control(car, road):
    """Set an agent's steering and an unbounded proportional acceleration for a sub-step."""
    _follow_road(car, road)
    car.steering = motion.steering(car, road.lanes[car.target_lane])
    car.acceleration = motion.SPEED_GAIN * (car.target_speed - car.speed)
