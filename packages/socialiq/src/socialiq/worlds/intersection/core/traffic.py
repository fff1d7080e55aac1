"""Drivers of the crossing: their way and leader, right of way, the ego's commands, its arrival."""

import math

import numpy as np

from socialiq.worlds.highway.core import geometry
from socialiq.worlds.highway.core import vehicle as motion
from socialiq.worlds.highway.core.compile import allocating_kernel, inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, longitudinal
from socialiq.worlds.highway.core.vehicle import MAX_ACCELERATION, clip
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.intersection.core import geometry as crossing
from socialiq.worlds.intersection.core.geometry import LANES, LEGS, ROUTES
from socialiq.worlds.intersection.options import FASTER, IDLE, SPEED_LIMIT, VEHICLE

EXIT_DISTANCE = 25.0  # m along an exit at which the ego has arrived


@kernel
def follow_road(vehicle):
    """Select the route's next lane from 2.5 m before the end of the current lane.

    After an exit follows the approach of its arm: only an agent gets there.
    """
    lane = LANES[vehicle.target_lane]
    if longitudinal(lane, vehicle.x, vehicle.y) <= lane.length - VEHICLE_LENGTH / 2:
        return
    legs = LEGS[vehicle.origin, vehicle.destination]
    if vehicle.leg < legs:
        if ROUTES[vehicle.origin, vehicle.destination, vehicle.leg] == vehicle.target_lane:
            vehicle.leg += 1
        if vehicle.leg < legs:
            vehicle.target_lane = ROUTES[vehicle.origin, vehicle.destination, vehicle.leg]
        elif vehicle.target_lane % 5 == EXIT:
            vehicle.target_lane = 5 * ((vehicle.target_lane // 5 + 3) % 4)


@kernel
def leader(vehicles, count, me, lane_number, settings):
    """Return the slot of the nearest vehicle ahead on a lane, -1 if none; the last of equals."""
    lane = LANES[lane_number]
    here = longitudinal(lane, vehicles[me].x, vehicles[me].y)
    searched = crossing.CONNECTED.shape[1] if settings.connected_lanes else 1
    front, nearest = -1, math.inf
    for slot in range(count):
        if slot == me:
            continue
        x, y = vehicles[slot].x, vehicles[slot].y
        for column in range(searched):
            number = crossing.CONNECTED[lane_number, column]
            if number < 0:
                break
            connected = LANES[number]
            if abs(geometry.lateral(connected, x, y)) > geometry.LANE_WIDTH / 2 + 1:
                continue
            along = longitudinal(connected, x, y)
            if not -VEHICLE_LENGTH <= along < connected.length + VEHICLE_LENGTH:
                continue
            along += crossing.CONNECTED_OFFSETS[lane_number, column]
            if here <= along <= nearest + settings.tie:
                front, nearest = slot, along
            break
    return front


@kernel
def idm_acceleration(vehicles, me, front):
    """Return the acceleration in m/s² of the Intelligent Driver Model behind a leader or none.

    The gap is measured along the closest lane, also to a leader on the target lane.
    """
    vehicle = vehicles[me]
    free = motion.free_acceleration(vehicle, SPEED_LIMIT, vehicle.exponent)
    if front < 0:
        return free
    return free - motion.braking_for(vehicle, vehicles[front], LANES[vehicle.lane])


@inlined_kernel
def drive(vehicles, count, me, settings):
    """Set a traffic driver's steering and acceleration for a sub-step."""
    vehicle = vehicles[me]
    if vehicle.crashed:
        return
    follow_road(vehicle)
    vehicle.steering = motion.steering(vehicle, LANES[vehicle.target_lane])
    front = leader(vehicles, count, me, vehicle.lane, settings)
    acceleration = idm_acceleration(vehicles, me, front)
    if vehicle.lane != vehicle.target_lane:
        front = leader(vehicles, count, me, vehicle.target_lane, settings)
        acceleration = min(acceleration, idm_acceleration(vehicles, me, front))
    vehicle.acceleration = clip(acceleration, -MAX_ACCELERATION, MAX_ACCELERATION)


@kernel
def choose(vehicle, action, _road, settings):
    """Set the target speed that an action selects; IDLE keeps the current target speed."""
    if settings.continuous:
        return
    follow_road(vehicle)
    if action != IDLE:
        change = 1 if action == FASTER else -1
        level = motion.speed_index(vehicle.speed, settings) + change
        vehicle.target_speed = settings.target_speeds[clip(level, 0, settings.n_speeds - 1)]


@inlined_kernel
def control(vehicle):
    """Set steering and an unbounded proportional acceleration for a sub-step."""
    follow_road(vehicle)
    vehicle.steering = motion.steering(vehicle, LANES[vehicle.target_lane])
    vehicle.acceleration = motion.SPEED_GAIN * (vehicle.target_speed - vehicle.speed)


@kernel
def arrived(vehicle, _road):
    """Whether a vehicle is 25 m along any exit."""
    if vehicle.lane % 5 != EXIT:
        return False
    return longitudinal(LANES[vehicle.lane], vehicle.x, vehicle.y) >= EXIT_DISTANCE


@kernel
def route_coordinate(vehicle, _road):
    """Return the metres from the start of the approach along the vehicle's planned route."""
    passed = 0.0
    for leg in range(2):
        lane = LANES[ROUTES[vehicle.origin, vehicle.destination, leg]]
        along = longitudinal(lane, vehicle.x, vehicle.y)
        if along <= lane.length:
            return passed + max(along, 0.0)
        passed += lane.length
    lane = LANES[ROUTES[vehicle.origin, vehicle.destination, 2]]
    return passed + max(longitudinal(lane, vehicle.x, vehicle.y), 0.0)


N_PREDICTIONS = 11  # every quarter of a second up to 2.75 s
PREDICTION_STEP = 0.25  # s
LONG = 1.5 * VEHICLE_LENGTH  # of the rectangle around a predicted vehicle, m
WIDE = 0.9 * geometry.VEHICLE_WIDTH
_SURELY_APART = VEHICLE_LENGTH * VEHICLE_LENGTH * (1 + 1e-9)


@allocating_kernel
def enforce(vehicles, count, settings):
    """Release all vehicles, then stop the yielding vehicle of every pair whose predictions meet.

    An agent never yields: where it would have to, neither vehicle does.
    """
    for slot in range(count):
        if vehicles[slot].yielding:
            vehicles[slot].yielding = False
            vehicles[slot].target_speed = min(SPEED_LIMIT, vehicles[slot].desired_speed)
    predictions = np.empty((count, N_PREDICTIONS, 3))
    for slot in range(count):
        if settings.continuous and vehicles[slot].agent >= 0:
            _predict_held(vehicles[slot], predictions[slot])
        else:
            _predict(vehicles[slot], predictions[slot])
    for first in range(count - 1):
        for second in range(first + 1, count):
            slot = yielder(vehicles, first, second, settings.tie)
            if vehicles[slot].agent >= 0 or vehicles[slot].yielding:
                continue
            if _meet(predictions[first], predictions[second]):
                vehicles[slot].yielding, vehicles[slot].target_speed = True, 0.0


@kernel
def yielder(vehicles, first, second, tie):
    """Return the slot of the vehicle that must yield: lower priority, else further away."""
    vehicle, partner = vehicles[first], vehicles[second]
    priority, partner_priority = LANES[vehicle.lane].priority, LANES[partner.lane].priority
    if priority != partner_priority:
        return second if priority > partner_priority else first
    behind = _ahead(vehicle, partner) > _ahead(partner, vehicle) + tie
    return first if behind else second


@kernel
def _ahead(vehicle, partner):
    """Return the distance of another vehicle ahead, m."""
    dx, dy = partner.x - vehicle.x, partner.y - vehicle.y
    return vehicle.along_x * dx + vehicle.along_y * dy


@kernel
def _predict(vehicle, predictions):
    """Write positions and headings along the rest of the route at the present speed.

    The coordinate is that of the closest lane, but the walk begins at the route's first lane that
    is not behind. Where these differ, in the last 2.5 m of a lane, the prediction is far ahead of
    the vehicle; highway-env does the same.
    """
    start = longitudinal(LANES[vehicle.lane], vehicle.x, vehicle.y)
    legs = LEGS[vehicle.origin, vehicle.destination]
    for number in range(N_PREDICTIONS):
        along = start + vehicle.speed * (PREDICTION_STEP * (number + 1))
        leg = vehicle.leg
        lane = LANES[vehicle.lane]
        if leg < legs:
            lane = LANES[ROUTES[vehicle.origin, vehicle.destination, leg]]
            while leg < legs - 1 and along > lane.length:
                along -= lane.length
                leg += 1
                lane = LANES[ROUTES[vehicle.origin, vehicle.destination, leg]]
        predictions[number, 0], predictions[number, 1] = geometry.position(lane, along)
        predictions[number, 2] = geometry.heading_at(lane, along)


@allocating_kernel
def _predict_held(vehicle, predictions):
    """Write positions and headings at the present speed and angle of the wheels."""
    ahead = np.empty(1, VEHICLE)
    ahead[0] = vehicle
    ahead[0].acceleration = 0.0
    for number in range(N_PREDICTIONS):
        motion.advance(ahead[0], PREDICTION_STEP)
        predictions[number, 0], predictions[number, 1] = ahead[0].x, ahead[0].y
        predictions[number, 2] = ahead[0].heading


@kernel
def _meet(path, other_path):
    """Whether two vehicles' rectangles touch at any of the predicted times."""
    for number in range(N_PREDICTIONS):
        dx, dy = other_path[number, 0] - path[number, 0], other_path[number, 1] - path[number, 1]
        squared = dx * dx + dy * dy
        if squared > _SURELY_APART or math.sqrt(squared) > VEHICLE_LENGTH:
            continue
        first, second = path[number], other_path[number]
        if _has_point_inside(first, second) or _has_point_inside(second, first):
            return True
    return False


@kernel
def _has_point_inside(points_of, rectangle):
    """Whether a corner, middle of a side or centre of one rectangle lies in another.

    The test turns the points by the rectangle's heading instead of against it, which is wrong in
    turns; highway-env does the same.
    """
    cos, sin = math.cos(points_of[2]), math.sin(points_of[2])
    other_cos, other_sin = math.cos(rectangle[2]), math.sin(rectangle[2])
    for row in range(-1, 2):
        for column in range(-1, 2):
            along, across = row * LONG / 2, column * WIDE / 2
            dx = cos * along - sin * across + points_of[0] - rectangle[0]
            dy = sin * along + cos * across + points_of[1] - rectangle[1]
            along_other = abs(other_cos * dx - other_sin * dy)
            across_other = abs(other_sin * dx + other_cos * dy)
            if along_other <= LONG / 2 and across_other <= WIDE / 2:
                return True
    return False
