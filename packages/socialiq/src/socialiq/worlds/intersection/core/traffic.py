"""Drivers of the crossing: their way and leader, the ego's commands, and its arrival."""

from __future__ import annotations

import math

from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import LANE_WIDTH, VEHICLE_LENGTH, lateral, longitudinal
from socialiq.worlds.highway.core.vehicle import (
    MAX_ACCELERATION,
    SPEED_GAIN,
    advance,
    braking_for,
    clip,
    free_acceleration,
    speed_index,
    steering,
)
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.intersection.core.geometry import (
    CONNECTED,
    CONNECTED_OFFSETS,
    LANES,
    ROUTES,
    SPEED_LIMIT,
    closest_lane,
)
from socialiq.worlds.intersection.state import FASTER, IDLE

LEG_COUNT = 3
EXIT_DISTANCE = 25.0  # m along an exit at which the ego has arrived


@kernel
def follow_road(vehicle):
    """Select the route's next lane from 2.5 m before the end of the current lane.

    An exit has no next lane: vehicles are removed before its end.
    """
    lane = LANES[vehicle.target_lane]
    if longitudinal(lane, vehicle.x, vehicle.y) <= lane.length - VEHICLE_LENGTH / 2:
        return
    if vehicle.leg < LEG_COUNT:
        if ROUTES[vehicle.origin, vehicle.destination, vehicle.leg] == vehicle.target_lane:
            vehicle.leg += 1
        if vehicle.leg < LEG_COUNT:
            vehicle.target_lane = ROUTES[vehicle.origin, vehicle.destination, vehicle.leg]


@kernel
def leader(vehicles, count, me, lane_number, settings):
    """Return the slot of the nearest vehicle ahead on a lane, -1 if none; the last of equals."""
    lane = LANES[lane_number]
    here = longitudinal(lane, vehicles[me].x, vehicles[me].y)
    searched = CONNECTED.shape[1] if settings.connected_lanes else 1
    front, nearest = -1, math.inf
    for slot in range(count):
        if slot == me:
            continue
        x, y = vehicles[slot].x, vehicles[slot].y
        for column in range(searched):
            number = CONNECTED[lane_number, column]
            if number < 0:
                break
            connected = LANES[number]
            if abs(lateral(connected, x, y)) > LANE_WIDTH / 2 + 1:
                continue
            along = longitudinal(connected, x, y)
            if not -VEHICLE_LENGTH <= along < connected.length + VEHICLE_LENGTH:
                continue
            along += CONNECTED_OFFSETS[lane_number, column]
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
    free = free_acceleration(vehicle, SPEED_LIMIT, vehicle.exponent)
    if front < 0:
        return free
    return free - braking_for(vehicle, vehicles[front], LANES[vehicle.lane])


@inlined_kernel
def drive(vehicles, count, me, settings):
    """Set a traffic driver's steering and acceleration for a sub-step."""
    vehicle = vehicles[me]
    if vehicle.crashed:
        return
    follow_road(vehicle)
    vehicle.steering = steering(vehicle, LANES[vehicle.target_lane])
    front = leader(vehicles, count, me, vehicle.lane, settings)
    acceleration = idm_acceleration(vehicles, me, front)
    if vehicle.lane != vehicle.target_lane:
        front = leader(vehicles, count, me, vehicle.target_lane, settings)
        acceleration = min(acceleration, idm_acceleration(vehicles, me, front))
    vehicle.acceleration = clip(acceleration, -MAX_ACCELERATION, MAX_ACCELERATION)


@inlined_kernel
def move(vehicle, dt, tie):
    """Advance a vehicle by a sub-step, and find its closest lane."""
    advance(vehicle, dt)
    vehicle.lane = closest_lane(vehicle.x, vehicle.y, vehicle.heading, vehicle.lane, tie)


@inlined_kernel
def choose(vehicle, action, settings):
    """Set the target speed that an action selects; IDLE keeps the current target speed."""
    follow_road(vehicle)
    if action != IDLE:
        change = 1 if action == FASTER else -1
        level = speed_index(vehicle.speed, settings) + change
        vehicle.target_speed = settings.target_speeds[clip(level, 0, settings.n_speeds - 1)]


@inlined_kernel
def control(vehicle):
    """Set steering and an unbounded proportional acceleration for a sub-step."""
    follow_road(vehicle)
    vehicle.steering = steering(vehicle, LANES[vehicle.target_lane])
    vehicle.acceleration = SPEED_GAIN * (vehicle.target_speed - vehicle.speed)


@kernel
def arrived(vehicle):
    """Whether a vehicle is 25 m along any exit."""
    if vehicle.lane % 5 != EXIT:
        return False
    return longitudinal(LANES[vehicle.lane], vehicle.x, vehicle.y) >= EXIT_DISTANCE


@kernel
def route_coordinate(vehicle):
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
