"""Angles, coordinates along straight, swinging and circular lanes, and the choice of a lane."""

import math

from socialiq.physics import wrapped
from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.network import CLOSE, LANE_WIDTH

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


VEHICLE_LENGTH = 5.0  # m
VEHICLE_WIDTH = 2.0  # m


@kernel
def distance(x, y, other_x, other_y):
    """Return the Euclidean distance of two points, m.

    Args:
        x: x of the first point, m.
        y: y of the first point, m.
        other_x: x of the second point, m.
        other_y: y of the second point, m.
    """
    dx = x - other_x
    dy = y - other_y
    return math.sqrt(dx * dx + dy * dy)


@kernel
def lateral(lane, x, y):
    """Return the distance of a point to the right of a lane's centre line, m.

    Args:
        lane: Record of the lane.
        x: x of the point, m.
        y: y of the point, m.

    Returns:
        The distance; negative to the left.
    """
    dx = x - lane.x
    dy = y - lane.y
    if not lane.straight:
        return lane.sense * (lane.radius - math.sqrt(dx * dx + dy * dy))
    offset = dx * lane.across_x + dy * lane.across_y
    if lane.amplitude == 0.0:
        return offset
    phase = lane.pulsation * longitudinal(lane, x, y) + lane.shift
    return offset - lane.amplitude * math.sin(phase)


@kernel
def longitudinal(lane, x, y):
    """Return a point's coordinate along a lane, m.

    Args:
        lane: Record of the lane.
        x: x of the point, m.
        y: y of the point, m.

    Returns:
        The coordinate; negative before the lane's start.
    """
    dx = x - lane.x
    dy = y - lane.y
    if lane.straight:
        return dx * lane.along_x + dy * lane.along_y
    phase = lane.phase + wrap_to_pi(math.atan2(dy, dx) - lane.phase)
    return lane.sense * (phase - lane.phase) * lane.radius


@kernel
def position(lane, along):
    """Return the point of a lane's centre line at a coordinate along it.

    Args:
        lane: Record of the lane.
        along: Coordinate along the lane, m.

    Returns:
        x and y, m.
    """
    if lane.straight:
        x = lane.x + along * lane.along_x
        y = lane.y + along * lane.along_y
        if lane.amplitude == 0.0:
            return x, y
        offset = lane.amplitude * math.sin(lane.pulsation * along + lane.shift)
        return x + offset * lane.across_x, y + offset * lane.across_y
    phase = lane.sense * along / lane.radius + lane.phase
    return lane.x + lane.radius * math.cos(phase), lane.y + lane.radius * math.sin(phase)


@kernel
def heading_at(lane, along):
    """Return the direction of a lane at a coordinate along it, rad.

    Args:
        lane: Record of the lane.
        along: Coordinate along the lane, m.
    """
    if lane.straight:
        if lane.amplitude == 0.0:
            return lane.heading
        phase = lane.pulsation * along + lane.shift
        return lane.heading + atan(lane.amplitude * lane.pulsation * math.cos(phase))
    return lane.sense * along / lane.radius + lane.phase + math.pi / 2 * lane.sense


@kernel
def on_lane(lane, x, y, margin):
    """Whether a point lies on a lane, which is lengthened at both ends by a vehicle's length.

    Args:
        lane: Record of the lane.
        x: x of the point, m.
        y: y of the point, m.
        margin: Metres by which the lane is widened on both sides.
    """
    if abs(lateral(lane, x, y)) > LANE_WIDTH / 2 + margin:
        return False
    along = longitudinal(lane, x, y)
    return -VEHICLE_LENGTH <= along < lane.length + VEHICLE_LENGTH


@kernel
def misfit(lane, x, y):
    """Return the metres of a point sideways and beyond the ends of a lane.

    Args:
        lane: Record of the lane.
        x: x of the point, m.
        y: y of the point, m.
    """
    along = longitudinal(lane, x, y)
    return abs(lateral(lane, x, y)) + max(along - lane.length, 0.0) + max(0.0 - along, 0.0)


@kernel
def turned_misfit(lane, x, y, heading, enough):
    """Return the misfit plus the angle between a heading and the lane's, m and rad.

    Args:
        lane: Record of the lane.
        x: x of the point, m.
        y: y of the point, m.
        heading: Heading, rad.
        enough: Misfit in m above which infinity is returned.
    """
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
    """Whether a driver at a point may change to a lane.

    Args:
        lane: Record of the lane.
        x: x of the point, m.
        y: y of the point, m.
    """
    if lane.forbidden or abs(lateral(lane, x, y)) > 2 * LANE_WIDTH:
        return False
    return 0 <= longitudinal(lane, x, y) < lane.length + VEHICLE_LENGTH


@kernel
def closest_lane(lanes, x, y, heading, guess, tie):
    """Return the number of the lane of least misfit plus heading in rad; the first of equals.

    Lanes that are too far are not examined further: the misfit in place is the length of a way to
    the lane, so at least the distance to its box. A guess that fits where no other lane is near is
    returned at once.

    Args:
        lanes: Records of the lanes.
        x: x of the point, m.
        y: y of the point, m.
        heading: Heading, rad.
        guess: Number of a lane that only saves time.
        tie: Difference within which lanes are equally close.
    """
    best = guess
    lane = lanes[guess]
    least = turned_misfit(lane, x, y, heading, math.inf)
    if least < CLOSE and lane.alone_from < longitudinal(lane, x, y) < lane.alone_to:
        return best
    for number in range(len(lanes)):
        lane = lanes[number]
        beside = max(lane.low_x - x, x - lane.high_x, lane.low_y - y, y - lane.high_y)
        if number == guess or beside > least + tie:
            continue
        away = turned_misfit(lane, x, y, heading, least + tie)
        if away < least - tie or (away <= least + tie and number < best):
            best = number
            least = away
    return best


@kernel
def following(vehicle, lanes, routes, successors):
    """Return the lane after a vehicle's target lane, by its way, else the closest.

    Args:
        vehicle: Record of the vehicle; its `leg` is advanced where a road of its way is completed.
        lanes: Records of the lanes.
        routes: Table of ways, as of `scenes.Road`.
        successors: Table of the roads that follow each.

    Returns:
        Number of the lane; the target lane itself where no road follows.
    """
    lane = lanes[vehicle.target_lane]
    x, y = position(lane, longitudinal(lane, vehicle.x, vehicle.y))
    if vehicle.route >= 0:
        way = routes[vehicle.route, vehicle.destination]
        if vehicle.leg < len(way) and way[vehicle.leg] == lane.first:
            vehicle.leg += 1
        if vehicle.leg < len(way) and way[vehicle.leg] >= 0:
            planned = way[vehicle.leg]
            if lanes[planned].start == lane.end:
                return _lane_of(planned, lane, lanes, x, y)
    best = vehicle.target_lane + 0
    least = math.inf
    for column in range(successors.shape[1]):
        successor = successors[lane.road, column]
        if successor < 0:
            break
        candidate = _lane_of(successor, lane, lanes, x, y)
        away = misfit(lanes[candidate], x, y)
        if away < least:
            best = candidate
            least = away
    return best


@kernel
def _lane_of(first, lane, lanes, x, y):
    """Return the lane of a road that a driver takes: of equal number, else the closest."""
    if lanes[first].lanes == lane.lanes:
        return first + lane.number
    best = first
    least = math.inf
    for number in range(first, first + lanes[first].lanes):
        away = misfit(lanes[number], x, y)
        if away < least:
            best = number
            least = away
    return best
