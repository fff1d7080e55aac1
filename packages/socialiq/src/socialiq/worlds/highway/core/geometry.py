"""Angles, coordinates along straight, swinging and circular lanes, and the choice of a lane."""

import math

from socialiq.physics import wrapped
from socialiq.worlds.highway.core.compile import kernel

# Most vehicles drive straight along the centre of a lane, so most angles are rounding errors. Below
# this the sine, tangent and their inverses round to the argument itself, in libm too.
_SMALL = 1e-9


@kernel
def wrap_to_pi(angle):
    """Return `physics.wrapped`, without its division for angles that are in range."""
    turned = angle + math.pi
    return turned - math.pi if 0.0 <= turned < 2 * math.pi else wrapped(angle)


@kernel
def sin(angle):
    """Return the sine of an angle in rad."""
    return angle if abs(angle) < _SMALL else math.sin(angle)


@kernel
def tan(angle):
    """Return the tangent of an angle in rad."""
    return angle if abs(angle) < _SMALL else math.tan(angle)


@kernel
def asin(value):
    """Return the arcsine in rad."""
    return value if abs(value) < _SMALL else math.asin(value)


@kernel
def atan(value):
    """Return the arctangent in rad."""
    return value if abs(value) < _SMALL else math.atan(value)


LANE_WIDTH = 4.0  # m
VEHICLE_LENGTH = 5.0  # m
VEHICLE_WIDTH = 2.0  # m


@kernel
def distance(x, y, other_x, other_y):
    """Return the Euclidean distance of two points, m."""
    dx, dy = x - other_x, y - other_y
    return math.sqrt(dx * dx + dy * dy)


@kernel
def lateral(lane, x, y):
    """Return the distance of a point to the right of a lane's centre line, m."""
    dx, dy = x - lane.x, y - lane.y
    if not lane.straight:
        return lane.sense * (lane.radius - math.sqrt(dx * dx + dy * dy))
    offset = dx * lane.across_x + dy * lane.across_y
    if lane.amplitude == 0.0:
        return offset
    phase = lane.pulsation * longitudinal(lane, x, y) + lane.shift
    return offset - lane.amplitude * math.sin(phase)


@kernel
def longitudinal(lane, x, y):
    """Return a point's coordinate along a lane, m; negative before its start."""
    dx, dy = x - lane.x, y - lane.y
    if lane.straight:
        return dx * lane.along_x + dy * lane.along_y
    phase = lane.phase + wrap_to_pi(math.atan2(dy, dx) - lane.phase)
    return lane.sense * (phase - lane.phase) * lane.radius


@kernel
def position(lane, along):
    """Return the point of a lane's centre line at a coordinate along it."""
    if lane.straight:
        x, y = lane.x + along * lane.along_x, lane.y + along * lane.along_y
        if lane.amplitude == 0.0:
            return x, y
        offset = lane.amplitude * math.sin(lane.pulsation * along + lane.shift)
        return x + offset * lane.across_x, y + offset * lane.across_y
    phase = lane.sense * along / lane.radius + lane.phase
    return lane.x + lane.radius * math.cos(phase), lane.y + lane.radius * math.sin(phase)


@kernel
def heading_at(lane, along):
    """Return the direction of a lane at a coordinate along it, rad."""
    if lane.straight:
        if lane.amplitude == 0.0:
            return lane.heading
        phase = lane.pulsation * along + lane.shift
        return lane.heading + atan(lane.amplitude * lane.pulsation * math.cos(phase))
    return lane.sense * along / lane.radius + lane.phase + math.pi / 2 * lane.sense


@kernel
def on_lane(lane, x, y, margin):
    """Whether a point lies on a lane, widened on both sides, lengthened by a vehicle's length."""
    if abs(lateral(lane, x, y)) > LANE_WIDTH / 2 + margin:
        return False
    along = longitudinal(lane, x, y)
    return -VEHICLE_LENGTH <= along < lane.length + VEHICLE_LENGTH


@kernel
def misfit(lane, x, y):
    """Return the metres sideways and beyond the ends of a lane."""
    along = longitudinal(lane, x, y)
    return abs(lateral(lane, x, y)) + max(along - lane.length, 0.0) + max(0.0 - along, 0.0)


@kernel
def turned_misfit(lane, x, y, heading, enough):
    """Return the misfit plus the angle to a heading in rad; infinity once it exceeds `enough`."""
    away = abs(lateral(lane, x, y))
    if away > enough:
        return math.inf
    along = longitudinal(lane, x, y)
    away = away + max(along - lane.length, 0.0) + max(0.0 - along, 0.0)
    if away > enough:
        return math.inf
    return away + abs(wrap_to_pi(heading - heading_at(lane, along)))


@kernel
def reachable(lane, x, y):
    """Whether a driver at a point may change to a lane."""
    if lane.forbidden or abs(lateral(lane, x, y)) > 2 * LANE_WIDTH:
        return False
    return 0 <= longitudinal(lane, x, y) < lane.length + VEHICLE_LENGTH


@kernel
def closest_lane(lanes, x, y, heading, guess):
    """Return the lane of least misfit plus heading in rad; the first of equals.

    The guess only saves time: lanes that are too far sideways are not examined further.
    """
    best = guess
    least = _boxed_misfit(lanes[guess], x, y, heading, math.inf)
    for number in range(len(lanes)):
        if number == guess:
            continue
        away = _boxed_misfit(lanes[number], x, y, heading, least)
        if away < least or (away == least and number < best):
            best, least = number, away
    return best


@kernel
def _boxed_misfit(lane, x, y, heading, enough):
    """Return `turned_misfit`, and infinity where the lane's box is too far.

    The misfit in place is the length of a way to the lane, so at least the distance to its box.
    """
    if max(lane.low_x - x, x - lane.high_x, lane.low_y - y, y - lane.high_y) > enough:
        return math.inf
    return turned_misfit(lane, x, y, heading, enough)


@kernel
def following(car, road):
    """Return the lane after a vehicle's target lane, by its way, else the closest; drop a leg."""
    lane, planned = road.lanes[car.target_lane], -1
    if car.route >= 0:
        way = road.routes[car.route, car.destination]
        if car.leg < len(way) and way[car.leg] == lane.road:
            car.leg += 1
        if car.leg < len(way) and way[car.leg] >= 0:
            first = 0
            while first < len(road.lanes) and road.lanes[first].road != way[car.leg]:
                first += 1
            if first < len(road.lanes) and road.lanes[first].start == lane.end:
                planned = way[car.leg]
    x, y = position(lane, longitudinal(lane, car.x, car.y))
    if planned >= 0:
        return _lane_of(planned, lane, road.lanes, x, y)
    best, least = car.target_lane + 0, math.inf
    for column in range(road.successors.shape[1]):
        successor = road.successors[lane.road, column]
        if successor < 0:
            break
        candidate = _lane_of(successor, lane, road.lanes, x, y)
        away = misfit(road.lanes[candidate], x, y)
        if away < least:
            best, least = candidate, away
    return best


@kernel
def _lane_of(following_road, lane, lanes, x, y):
    """Return the lane of a road that a driver takes: of equal number, else the closest."""
    first = 0
    while lanes[first].road != following_road:
        first += 1
    if lanes[first].lanes == lane.lanes:
        return first + lane.number
    best, least = first, math.inf
    for number in range(first, first + lanes[first].lanes):
        away = misfit(lanes[number], x, y)
        if away < least:
            best, least = number, away
    return best
