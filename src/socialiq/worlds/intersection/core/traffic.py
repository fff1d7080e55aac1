"""Vehicle models: lane steering, Intelligent Driver Model, kinematic bicycle."""

from __future__ import annotations

import math

from socialiq.worlds.intersection.core.compile import inlined_kernel, kernel
from socialiq.worlds.intersection.core.geometry import (
    CONNECTED,
    CONNECTED_OFFSETS,
    LANE_WIDTH,
    LANES,
    ROUTES,
    SPEED_LIMIT,
    VEHICLE_LENGTH,
    asin,
    atan,
    closest_lane,
    heading_at,
    lateral,
    longitudinal,
    sin,
    tan,
    wrap_to_pi,
)

LATERAL_GAIN = 1 / 0.6  # 1/s, lateral offset to lateral speed
HEADING_GAIN = 1 / 0.2  # 1/s, heading error to turning rate
LOOK_AHEAD = 0.5 * 0.2  # s
MAX_STEERING = math.pi / 3  # rad
MAX_ACCELERATION = 6.0  # m/s², of any driver, either way
MAX_SPEED = 40.0  # m/s, either way
LEG_COUNT = 3


@kernel
def not_zero(value):
    """Return the divisor, at least 0.01 away from zero, with its sign."""
    if abs(value) > 1e-2:
        return value
    return 1e-2 if value >= 0 else -1e-2


@kernel
def clip(value, low, high):
    """Return the nearest number within an interval."""
    return min(max(value, low), high)


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
def steering(vehicle):
    """Return the front wheel angle in rad that steers to the target lane's centre."""
    lane = LANES[vehicle.target_lane]
    ahead = longitudinal(lane, vehicle.x, vehicle.y) + vehicle.speed * LOOK_AHEAD
    return wheels(vehicle, heading_at(lane, ahead), lateral(lane, vehicle.x, vehicle.y))


@kernel
def wheels(vehicle, direction, offset):
    """Return the front wheel angle in rad that steers to the centre of a lane.

    The lateral offset gives a lateral speed, this a heading, this a turning rate, and this an angle
    of the wheels.

    Args:
        vehicle: VEHICLE record.
        direction: Heading of the lane a little ahead, rad.
        offset: Metres to the right of the lane's centre.
    """
    speed = not_zero(vehicle.speed)
    correction = asin(clip(-LATERAL_GAIN * offset / speed, -1.0, 1.0))
    wanted = direction + clip(correction, -math.pi / 4, math.pi / 4)
    rate = HEADING_GAIN * wrap_to_pi(wanted - vehicle.heading)
    slip = asin(clip(VEHICLE_LENGTH / 2 / speed * rate, -1.0, 1.0))
    return clip(atan(2 * tan(slip)), -MAX_STEERING, MAX_STEERING)


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
    """Return the acceleration in m/s² of the Intelligent Driver Model (Treiber et al. 2000).

    The gap is measured along the closest lane, also to a leader on the target lane. The desired
    gap may be negative if the leader is faster, as in highway-env.
    """
    vehicle = vehicles[me]
    target = abs(not_zero(clip(vehicle.target_speed, 0.0, SPEED_LIMIT)))
    strongest = vehicle.max_acceleration
    free = math.pow(max(vehicle.speed, 0.0) / target, vehicle.exponent)
    acceleration = strongest * (1 - free)
    if front < 0:
        return acceleration
    other = vehicles[front]
    lane = LANES[vehicle.lane]
    gap = longitudinal(lane, other.x, other.y) - longitudinal(lane, vehicle.x, vehicle.y)
    ratio = desired_gap(vehicle, other) / not_zero(gap)
    return acceleration - strongest * (ratio * ratio)


@kernel
def desired_gap(vehicle, other):
    """Return the model's desired gap to a leader, m."""
    closing_x = vehicle.speed * vehicle.along_x - other.speed * other.along_x
    closing_y = vehicle.speed * vehicle.along_y - other.speed * other.along_y
    closing = closing_x * vehicle.along_x + closing_y * vehicle.along_y
    # highway-env negates the product of the maximum and the (negative) comfortable value.
    product = vehicle.max_acceleration * vehicle.comfort_deceleration
    return (
        vehicle.jam_distance
        + vehicle.speed * vehicle.time_headway
        + vehicle.speed * closing / (2 * math.sqrt(product))
    )


@inlined_kernel
def drive(vehicles, count, me, settings):
    """Set a traffic driver's steering and acceleration for a sub-step."""
    vehicle = vehicles[me]
    if vehicle.crashed:
        return
    follow_road(vehicle)
    vehicle.steering = steering(vehicle)
    front = leader(vehicles, count, me, vehicle.lane, settings)
    acceleration = idm_acceleration(vehicles, me, front)
    if vehicle.lane != vehicle.target_lane:
        front = leader(vehicles, count, me, vehicle.target_lane, settings)
        acceleration = min(acceleration, idm_acceleration(vehicles, me, front))
    vehicle.acceleration = clip(acceleration, -MAX_ACCELERATION, MAX_ACCELERATION)


@kernel
def turned(vehicle, heading):
    """Set a vehicle's heading and cache its unit vector, which many kernels read."""
    if heading != vehicle.heading:
        vehicle.heading = heading
        vehicle.along_x, vehicle.along_y = math.cos(heading), math.sin(heading)


@inlined_kernel
def move(vehicle, dt, tie):
    """Advance a vehicle by a sub-step, and find its closest lane."""
    advance(vehicle, dt)
    vehicle.lane = closest_lane(vehicle.x, vehicle.y, vehicle.heading, vehicle.lane, tie)


@kernel
def advance(vehicle, dt):
    """Advance the kinematic bicycle model; a pending push moves the vehicle and marks a crash."""
    if vehicle.crashed:
        vehicle.steering = 0.0
        vehicle.acceleration = -1.0 * vehicle.speed
    if vehicle.speed > MAX_SPEED:
        vehicle.acceleration = min(vehicle.acceleration, MAX_SPEED - vehicle.speed)
    elif vehicle.speed < -MAX_SPEED:
        vehicle.acceleration = max(vehicle.acceleration, -MAX_SPEED - vehicle.speed)
    slip = atan(0.5 * tan(vehicle.steering))
    direction = vehicle.heading + slip
    if direction != vehicle.heading:
        along_x, along_y = math.cos(direction), math.sin(direction)
    else:
        along_x, along_y = vehicle.along_x, vehicle.along_y
    vehicle.x += vehicle.speed * along_x * dt
    vehicle.y += vehicle.speed * along_y * dt
    if vehicle.pushed:
        vehicle.x += vehicle.push_x
        vehicle.y += vehicle.push_y
        vehicle.crashed = True
        vehicle.pushed = False
        vehicle.push_x = 0.0
        vehicle.push_y = 0.0
    turned(vehicle, vehicle.heading + vehicle.speed * sin(slip) / (VEHICLE_LENGTH / 2) * dt)
    vehicle.speed += vehicle.acceleration * dt
