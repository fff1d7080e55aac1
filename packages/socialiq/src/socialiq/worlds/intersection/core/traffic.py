"""Drivers of the crossing: their way, their leader, and who moves where."""

from __future__ import annotations

import math

from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import LANE_WIDTH, VEHICLE_LENGTH, lateral, longitudinal
from socialiq.worlds.highway.core.vehicle import (
    MAX_ACCELERATION,
    advance,
    braking_for,
    clip,
    free_acceleration,
    steering,
)
from socialiq.worlds.intersection.core.geometry import (
    CONNECTED,
    CONNECTED_OFFSETS,
    LANES,
    ROUTES,
    SPEED_LIMIT,
    closest_lane,
)

LEG_COUNT = 3


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
    mine = longitudinal(lane, vehicles[me].x, vehicles[me].y)
    looked_at = CONNECTED.shape[1] if settings.connected_lanes else 1
    found, nearest = -1, math.inf
    for other in range(count):
        if other == me:
            continue
        x, y = vehicles[other].x, vehicles[other].y
        for place in range(looked_at):
            number = CONNECTED[lane_number, place]
            if number < 0:
                break
            searched = LANES[number]
            if abs(lateral(searched, x, y)) > LANE_WIDTH / 2 + 1:
                continue
            along = longitudinal(searched, x, y)
            if not -VEHICLE_LENGTH <= along < searched.length + VEHICLE_LENGTH:
                continue
            along += CONNECTED_OFFSETS[lane_number, place]
            if mine <= along <= nearest + settings.tie:
                found, nearest = other, along
            break
    return found


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
