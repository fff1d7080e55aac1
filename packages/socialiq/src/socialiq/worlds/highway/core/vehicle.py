"""Vehicle on any road: steering, speed control, Intelligent Driver Model, kinematic bicycle."""

from __future__ import annotations

import math

import numpy as np

from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import (
    VEHICLE_LENGTH,
    asin,
    atan,
    heading_at,
    lateral,
    longitudinal,
    sin,
    tan,
    wrap_to_pi,
)
from socialiq.worlds.highway.state import MAX_SPEED

LATERAL_GAIN = 1 / 0.6  # 1/s, lateral offset to lateral speed
HEADING_GAIN = 1 / 0.2  # 1/s, heading error to turning rate
SPEED_GAIN = 1 / 0.6  # 1/s, of the ego's speed control
LOOK_AHEAD = 0.5 * 0.2  # s
MAX_STEERING = math.pi / 3  # rad
MAX_ACCELERATION = 6.0  # m/s², of any driver, either way


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
def steering(vehicle, lane):
    """Return the front wheel angle in rad that steers to the centre of a lane."""
    ahead = longitudinal(lane, vehicle.x, vehicle.y) + vehicle.speed * LOOK_AHEAD
    return wheels(vehicle, heading_at(lane, ahead), lateral(lane, vehicle.x, vehicle.y))


@kernel
def wheels(vehicle, direction, offset):
    """Return the front wheel angle in rad that steers to the centre of a lane.

    The lateral offset gives a lateral speed, this a heading, this a turning rate, and this an angle
    of the wheels.

    Args:
        vehicle: Record of a vehicle.
        direction: Heading of the lane a little ahead, rad.
        offset: Metres to the right of the lane's centre.
    """
    speed = not_zero(vehicle.speed)
    correction = asin(clip(-LATERAL_GAIN * offset / speed, -1.0, 1.0))
    aimed = direction + clip(correction, -math.pi / 4, math.pi / 4)
    rate = HEADING_GAIN * wrap_to_pi(aimed - vehicle.heading)
    slip = asin(clip(VEHICLE_LENGTH / 2 / speed * rate, -1.0, 1.0))
    return clip(atan(2 * tan(slip)), -MAX_STEERING, MAX_STEERING)


@kernel
def speed_index(speed, settings):
    """Return the index of the target speed nearest to a speed."""
    last = settings.n_speeds - 1
    lowest = settings.target_speeds[0]
    share = (speed - lowest) / (settings.target_speeds[last] - lowest)
    return np.int64(clip(np.rint(share * last), 0, last))


@kernel
def free_acceleration(vehicle, limit, exponent):
    """Return the acceleration in m/s² of the Intelligent Driver Model without a leader.

    Source: Treiber, Hennecke, Helbing 2000.

    Args:
        vehicle: Record of a vehicle.
        limit: Of the speed it aims at, m/s.
        exponent: Of the free-road term.
    """
    target = abs(not_zero(clip(vehicle.target_speed, 0.0, limit)))
    free = math.pow(max(vehicle.speed, 0.0) / target, exponent)
    return vehicle.max_acceleration * (1 - free)


@kernel
def braking_for(vehicle, other, lane):
    """Return what the model brakes for a leader, m/s²; the gap is measured along a lane.

    The desired gap may be negative if the leader is faster, as in highway-env.
    """
    gap = longitudinal(lane, other.x, other.y) - longitudinal(lane, vehicle.x, vehicle.y)
    ratio = desired_gap(vehicle, other) / not_zero(gap)
    return vehicle.max_acceleration * (ratio * ratio)


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


@kernel
def turned(vehicle, heading):
    """Set a vehicle's heading and cache its unit vector, which many kernels read."""
    if heading != vehicle.heading:
        vehicle.heading = heading
        vehicle.along_x, vehicle.along_y = math.cos(heading), math.sin(heading)


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
