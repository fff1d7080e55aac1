"""Vehicle on any road: steering, speed control, car following, kinematic bicycle, collisions."""

import math

import numpy as np

from socialiq import physics
from socialiq.worlds.highway.core.compile import allocating_kernel, kernel
from socialiq.worlds.highway.core.geometry import (
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    asin,
    atan,
    distance,
    heading_at,
    lateral,
    longitudinal,
    sin,
    tan,
    wrap_to_pi,
)
from socialiq.worlds.highway.options import MAX_SPEED, Contact

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
    """Return the nearest number within an interval.

    Args:
        value: Number to clip.
        low: Lower end.
        high: Upper end.
    """
    return min(max(value, low), high)


@kernel
def steering(vehicle, lane):
    """Return the front wheel angle in rad that steers to the centre of a lane.

    The lateral offset gives a lateral speed, this a heading, this a turning rate, and this an angle
    of the wheels.

    Args:
        vehicle: Record of the vehicle.
        lane: Record of the lane.
    """
    ahead = longitudinal(lane, vehicle.x, vehicle.y) + vehicle.speed * LOOK_AHEAD
    direction = heading_at(lane, ahead)
    offset = lateral(lane, vehicle.x, vehicle.y)
    speed = not_zero(vehicle.speed)
    correction = asin(clip(-LATERAL_GAIN * offset / speed, -1.0, 1.0))
    aimed = direction + clip(correction, -math.pi / 4, math.pi / 4)
    rate = HEADING_GAIN * wrap_to_pi(aimed - vehicle.heading)
    slip = asin(clip(VEHICLE_LENGTH / 2 / speed * rate, -1.0, 1.0))
    return clip(atan(2 * tan(slip)), -MAX_STEERING, MAX_STEERING)


@kernel
def speed_index(speed, settings):
    """Return the index of the target speed nearest to a speed.

    Args:
        speed: Speed, m/s.
        settings: SETTINGS record with the target speeds.
    """
    last = settings.n_speeds - 1
    lowest = settings.target_speeds[0]
    share = (speed - lowest) / (settings.target_speeds[last] - lowest)
    return np.int64(clip(np.rint(share * last), 0, last))


@kernel
def free_acceleration(vehicle, limit, exponent):
    """Return the acceleration in m/s² of the Intelligent Driver Model without a leader.

    Source: Treiber, Hennecke, Helbing 2000.

    Args:
        vehicle: Record of the vehicle.
        limit: Limit of the speed it aims at, m/s.
        exponent: Exponent δ of the free-road term.
    """
    target = abs(not_zero(clip(vehicle.target_speed, 0.0, limit)))
    free = math.pow(max(vehicle.speed, 0.0) / target, exponent)
    return vehicle.max_acceleration * (1 - free)


@kernel
def braking_for(vehicle, leader, lane):
    """Return the deceleration of the model for a leader, m/s².

    Args:
        vehicle: Record of the vehicle.
        leader: Record of its leader. The desired gap to a faster one may be negative, as in
            highway-env.
        lane: Record of the lane along which the gap between the centres is measured.
    """
    gap = longitudinal(lane, leader.x, leader.y) - longitudinal(lane, vehicle.x, vehicle.y)
    ratio = desired_gap(vehicle, leader) / not_zero(gap)
    return vehicle.max_acceleration * (ratio * ratio)


@kernel
def desired_gap(vehicle, leader):
    """Return the model's desired gap to a leader, m.

    Args:
        vehicle: Record of the vehicle.
        leader: Record of its leader.
    """
    closing_x = vehicle.speed * vehicle.along_x - leader.speed * leader.along_x
    closing_y = vehicle.speed * vehicle.along_y - leader.speed * leader.along_y
    closing = closing_x * vehicle.along_x + closing_y * vehicle.along_y
    steady = vehicle.jam_distance + vehicle.speed * vehicle.time_headway
    strongest = vehicle.max_acceleration
    comfort = vehicle.comfort_deceleration
    return physics.desired_gap(steady, vehicle.speed, closing, strongest, comfort)


@kernel
def advance(vehicle, dt):
    """Advance the kinematic bicycle model; a pending push moves the vehicle and marks a crash.

    Args:
        vehicle: Record of the vehicle, which is written.
        dt: Time of a sub-step, s.
    """
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
        along_x = math.cos(direction)
        along_y = math.sin(direction)
    else:
        along_x = vehicle.along_x
        along_y = vehicle.along_y
    vehicle.x += vehicle.speed * along_x * dt
    vehicle.y += vehicle.speed * along_y * dt
    if vehicle.pushed:
        vehicle.x += vehicle.push_x
        vehicle.y += vehicle.push_y
        vehicle.crashed = True
        vehicle.pushed = False
        vehicle.push_x = 0.0
        vehicle.push_y = 0.0
    heading = vehicle.heading + vehicle.speed * sin(slip) / (VEHICLE_LENGTH / 2) * dt
    if heading != vehicle.heading:  # its unit vector is read by many kernels
        vehicle.heading = heading
        vehicle.along_x = math.cos(heading)
        vehicle.along_y = math.sin(heading)
    vehicle.speed += vehicle.acceleration * dt


_DIAGONAL = math.sqrt(VEHICLE_LENGTH**2 + VEHICLE_WIDTH**2)
_OBSTACLE = 2.0  # m, length and width
_REACH = (_DIAGONAL + math.sqrt(2 * _OBSTACLE**2)) / 2
_EGO_STRUCK = int(Contact.EGO_STRUCK)
_EGO_WAS_STRUCK = int(Contact.EGO_WAS_STRUCK)


@kernel
def collide(episode, vehicles, records, agents, dt, tie):
    """Mark what overlaps as crashed, and push apart what overlaps or will in a sub-step.

    Two vehicles are pushed by half each, a vehicle at an obstacle by the whole. A push takes
    effect, and marks the crash, in the next sub-step; the last push of a vehicle counts.

    Args:
        episode: EPISODE record. For each agent that touches anything it keeps the last `Contact`
            and the identity of what it touched.
        vehicles: Records of vehicles, then of obstacles.
        records: Number of records; those behind the episode's vehicles are obstacles.
        agents: Number of agents.
        dt: Time of a sub-step, s.
        tie: Depths closer than this are equal, m.
    """
    count = episode.vehicles
    intact = 0  # one bit per agent
    for number in range(agents):
        slot = episode.controlled[number]
        if slot >= 0 and not vehicles[slot].crashed:
            intact |= 1 << number
    for first in range(count):
        car = vehicles[first]
        for second in range(first + 1, records):
            partner = vehicles[second]
            reach = _REACH if second >= count else _DIAGONAL
            if distance(partner.x, partner.y, car.x, car.y) > reach + car.speed * dt:
                continue
            sides = (_OBSTACLE, _OBSTACLE) if second >= count else (VEHICLE_LENGTH, VEHICLE_WIDTH)
            overlap, will_overlap, push_x, push_y = _separate(car, partner, sides, dt, tie)
            if will_overlap and second >= count:
                car.push_x = push_x
                car.push_y = push_y
                car.pushed = True
            elif will_overlap:
                car.push_x = push_x / 2
                car.push_y = push_y / 2
                car.pushed = True
                partner.push_x = -push_x / 2
                partner.push_y = -push_y / 2
                partner.pushed = True
            if overlap:
                car.crashed = True
                partner.crashed = True
            if intact and (overlap or will_overlap):
                _note_contact(episode, intact, car, partner)
                _note_contact(episode, intact, partner, car)


@kernel
def _note_contact(episode, intact, vehicle, touching):
    number = vehicle.agent
    if number >= 0 and intact >> number & 1:
        episode.contact[number] = who_struck(vehicle, touching)
        episode.touched[number] = touching.identity


@kernel
def contact_of(vehicles, ego, dt, contact, touched):
    """Return the ego's contact after a sub-step, with pairs in the order of `collide`.

    Args:
        vehicles: Records of the vehicles.
        ego: Slot of the ego.
        dt: Time of a sub-step, s.
        contact: `Contact` before the sub-step.
        touched: Identity of the vehicle touched before it, -1 if none.

    Returns:
        The contact and the identity, as given if the ego touches no vehicle.
    """
    for slot in range(len(vehicles)):
        if slot == ego:
            continue
        car = vehicles[min(slot, ego)]
        partner = vehicles[max(slot, ego)]
        if distance(partner.x, partner.y, car.x, car.y) > _DIAGONAL + car.speed * dt:
            continue
        sides = VEHICLE_LENGTH, VEHICLE_WIDTH
        overlap, will_overlap, _, _ = _separate(car, partner, sides, dt, 0.0)
        if overlap or will_overlap:
            contact = who_struck(vehicles[ego], vehicles[slot])
            touched = vehicles[slot].identity
    return contact, touched


@kernel
def who_struck(ego, partner):
    """Return the `Contact` by which vehicle's motion closed the gap between the centres."""
    dx = partner.x - ego.x
    dy = partner.y - ego.y
    ego_closes = ego.speed * (ego.along_x * dx + ego.along_y * dy)
    other_closes = -partner.speed * (partner.along_x * dx + partner.along_y * dy)
    return _EGO_STRUCK if ego_closes >= other_closes else _EGO_WAS_STRUCK


@allocating_kernel
def _separate(vehicle, partner, sides, dt, tie):
    """Separating-axis test of a vehicle and a rectangle of the given length and width, m.

    Returns:
        Whether they overlap, whether they will within `dt` at their speeds, and the shortest
        displacement (x, y) of the vehicle that would separate them then.
    """
    first = np.empty((4, 2))
    second = np.empty((4, 2))
    _write_corners(vehicle, VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2, first)
    _write_corners(partner, sides[0] / 2, sides[1] / 2, second)
    relative_x = vehicle.speed * vehicle.along_x * dt - partner.speed * partner.along_x * dt
    relative_y = vehicle.speed * vehicle.along_y * dt - partner.speed * partner.along_y * dt
    between_x = _mean(first, 0) - _mean(second, 0)
    between_y = _mean(first, 1) - _mean(second, 1)
    overlap = True
    will_overlap = True
    least = math.inf
    axis_x = 0.0
    axis_y = 0.0
    for side in range(8):
        corners = first if side < 4 else second
        begin = side % 4
        end = (side + 1) % 4
        normal_x = -corners[end, 1] + corners[begin, 1]
        normal_y = corners[end, 0] - corners[begin, 0]
        length = math.sqrt(normal_x * normal_x + normal_y * normal_y)
        normal_x = normal_x / length
        normal_y = normal_y / length
        low, high = _project(first, normal_x, normal_y)
        other_low, other_high = _project(second, normal_x, normal_y)
        if _gap(low, high, other_low, other_high) > 0:
            overlap = False
        approach = normal_x * relative_x + normal_y * relative_y
        if approach < 0:
            low += approach
        else:
            high += approach
        gap = _gap(low, high, other_low, other_high)
        if gap > 0:
            will_overlap = False
        if not overlap and not will_overlap:
            return False, False, 0.0, 0.0
        if abs(gap) < least - tie:
            least = abs(gap)
            away = between_x * normal_x + between_y * normal_y > 0
            axis_x = normal_x if away else -normal_x
            axis_y = normal_y if away else -normal_y
    return overlap, will_overlap, least * axis_x, least * axis_y


@kernel
def _write_corners(rectangle, half_length, half_width, corners):
    for corner in range(4):
        along = -half_length if corner < 2 else half_length
        across = half_width if corner == 1 or corner == 2 else -half_width
        corners[corner, 0] = rectangle.along_x * along - rectangle.along_y * across + rectangle.x
        corners[corner, 1] = rectangle.along_y * along + rectangle.along_x * across + rectangle.y


@kernel
def _mean(corners, axis):
    return (corners[0, axis] + corners[1, axis] + corners[2, axis] + corners[3, axis]) / 4


@kernel
def _project(corners, normal_x, normal_y):
    low = math.inf
    high = -math.inf
    for corner in range(4):
        along = corners[corner, 0] * normal_x + corners[corner, 1] * normal_y
        low = min(low, along)
        high = max(high, along)
    return low, high


@kernel
def _gap(low, high, other_low, other_high):
    """Return the distance of two intervals, negative if they overlap."""
    if low < other_low:
        return other_low - high
    return low - other_high
