"""Angles, and coordinates along straight, swinging and circular lanes."""

from __future__ import annotations

import math

from socialiq.worlds.highway.core.compile import kernel

# Most vehicles drive straight along the centre of a lane, so most angles are rounding errors. Below
# this the sine, tangent and their inverses round to the argument itself, in libm too.
_SMALL = 1e-9


@kernel
def wrap_to_pi(angle):
    """Return the same direction in [-π, π)."""
    turned = angle + math.pi
    if 0.0 <= turned < 2 * math.pi:
        return turned - math.pi
    return turned % (2 * math.pi) - math.pi


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
    return offset - lane.amplitude * math.sin(_swing(lane, longitudinal(lane, x, y)))


@kernel
def _swing(lane, along):
    """Return the phase of a lane that swings around a straight line, rad."""
    return lane.pulsation * along + lane.shift


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
        offset = lane.amplitude * math.sin(_swing(lane, along))
        return x + offset * lane.across_x, y + offset * lane.across_y
    phase = lane.sense * along / lane.radius + lane.phase
    return lane.x + lane.radius * math.cos(phase), lane.y + lane.radius * math.sin(phase)


@kernel
def heading_at(lane, along):
    """Return the direction of a lane at a coordinate along it, rad."""
    if lane.straight:
        if lane.amplitude == 0.0:
            return lane.heading
        return lane.heading + atan(lane.amplitude * lane.pulsation * math.cos(_swing(lane, along)))
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
    found = abs(lateral(lane, x, y))
    if found > enough:
        return math.inf
    along = longitudinal(lane, x, y)
    found = found + max(along - lane.length, 0.0) + max(0.0 - along, 0.0)
    if found > enough:
        return math.inf
    return found + abs(wrap_to_pi(heading - heading_at(lane, along)))
