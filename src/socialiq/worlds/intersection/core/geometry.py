"""Road: angles, twenty lanes of a four-armed crossing, and coordinates along them.

Arms are numbered south 0, west 1, north 2, east 3. Each corner of highway-env's building loop makes
five lanes: the approach, the right turn, the left turn, the way straight on, and the exit of the
arm to its left-hand side. x grows to the east and y to the south, so headings grow clockwise.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from socialiq.worlds.intersection.core.compile import kernel

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


N_LANES = 20
LANE_WIDTH = 4.0
ACCESS_LENGTH = 100.0  # of approaches and exits, m
SPEED_LIMIT = 10.0  # of every lane, m/s
VEHICLE_LENGTH = 5.0
VEHICLE_WIDTH = 2.0

APPROACH, RIGHT, LEFT, STRAIGHT, EXIT = range(5)  # a lane's number is 5 * corner + its kind

LANE = np.dtype(
    [
        ("straight", np.bool_),
        ("length", np.float64),
        ("heading", np.float64),  # of a straight lane
        ("x", np.float64),  # start of a straight lane, centre of a turn
        ("y", np.float64),
        ("along_x", np.float64),  # unit vectors of a straight lane
        ("along_y", np.float64),
        ("across_x", np.float64),
        ("across_y", np.float64),
        ("radius", np.float64),  # of a turn
        ("phase", np.float64),  # angle at which a turn starts
        ("sense", np.float64),  # 1 clockwise as drawn, -1 the other way
        ("priority", np.int64),
    ],
    align=True,
)
"""Lane record: a straight line or an arc of a circle."""


def _lanes() -> np.ndarray:
    right, half = LANE_WIDTH + 5.0, LANE_WIDTH / 2
    left = right + LANE_WIDTH
    outer = right + half
    lanes = np.zeros(N_LANES, LANE)
    for corner in range(4):
        angle = math.radians(90 * corner)
        priority = 3 if corner % 2 else 1
        at = 5 * corner
        stop_line = _turned(angle, half, outer)
        lanes[at + APPROACH] = _line(
            _turned(angle, half, ACCESS_LENGTH + outer), stop_line, priority
        )
        lanes[at + RIGHT] = _arc(
            _turned(angle, outer, outer), right, angle + math.pi, math.radians(90), 1.0, priority
        )
        centre = _turned(angle, -left + half, left - half)
        lanes[at + LEFT] = _arc(centre, left, angle, math.radians(-90), -1.0, priority - 1)
        lanes[at + STRAIGHT] = _line(stop_line, _turned(angle, half, -outer), priority)
        lanes[at + EXIT] = _line(
            _turned(angle, outer, half), _turned(angle, ACCESS_LENGTH + outer, half), priority
        )
    return lanes


def _turned(angle: float, x: float, y: float) -> tuple[float, float]:
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


def _line(start: tuple[float, float], end: tuple[float, float], priority: int) -> tuple:
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.sqrt(dx * dx + dy * dy)
    along = dx / length, dy / length
    heading = math.atan2(dy, dx)
    return (True, length, heading, *start, *along, -along[1], along[0], 0, 0, 0, priority)


def _arc(
    centre: tuple[float, float],
    radius: float,
    phase: float,
    turn: float,
    sense: float,
    priority: int,
) -> tuple:
    length = radius * ((phase + turn) - phase) * sense
    return (False, length, 0, *centre, 0, 0, 0, 0, radius, phase, sense, priority)


LANES: Any = _lanes()
"""Lanes in highway-env's order, which decides between equally close lanes."""


def turn(origin: int, destination: int) -> int:
    """Return the number of the lane across the junction from one arm to another."""
    return 5 * origin + {3: RIGHT, 1: LEFT, 2: STRAIGHT}[(destination - origin) % 4]


def exit_of(arm: int) -> int:
    """Return the number of the lane that leaves the junction by an arm."""
    return 5 * ((arm + 1) % 4) + EXIT


def _routes() -> np.ndarray:
    routes = np.full((4, 4, 3), -1, np.int64)
    for origin in range(4):
        for destination in range(4):
            if origin != destination:
                lanes = 5 * origin, turn(origin, destination), exit_of(destination)
                routes[origin, destination] = lanes
    return routes


ROUTES = _routes()
"""Three lanes of a route, by the arm of origin and the arm of exit."""


def _connected() -> tuple[np.ndarray, np.ndarray]:
    lanes = np.full((N_LANES, 5), -1, np.int64)
    offsets = np.zeros((N_LANES, 5))
    for lane in range(N_LANES):
        following, preceding = _following(lane), _preceding(lane)
        found = [lane, *following, *preceding]
        shift = [0.0] + [LANES[lane]["length"]] * len(following)
        shift += [-LANES[other]["length"] for other in preceding]
        lanes[lane, : len(found)] = found
        offsets[lane, : len(found)] = shift
    return lanes, offsets


def _following(lane: int) -> list[int]:
    corner, kind = divmod(lane, 5)
    if kind == APPROACH:
        return [lane + RIGHT, lane + LEFT, lane + STRAIGHT]
    if kind == EXIT:
        return [5 * ((corner - 1) % 4)]
    return [exit_of((corner + {RIGHT: 3, LEFT: 1, STRAIGHT: 2}[kind]) % 4)]


def _preceding(lane: int) -> list[int]:
    return [other for other in range(N_LANES) if lane in _following(other)]


CONNECTED, CONNECTED_OFFSETS = _connected()
"""Lanes on which a driver with connected lanes searches for a leader, in search order."""


_CLOSE = 1.0  # m; on an arm, no other lane is closer than this
_OUTSIDE = 15.0  # m from the centre; the junction's own lanes reach 11 m


@kernel
def distance(x, y, other_x, other_y):
    """Return the Euclidean distance of two points, m."""
    dx, dy = x - other_x, y - other_y
    return math.sqrt(dx * dx + dy * dy)


@kernel
def lateral(lane, x, y):
    """Return the distance of a point to the right of a lane's centre line, m."""
    dx, dy = x - lane.x, y - lane.y
    if lane.straight:
        return dx * lane.across_x + dy * lane.across_y
    return lane.sense * (lane.radius - math.sqrt(dx * dx + dy * dy))


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
        return lane.x + along * lane.along_x, lane.y + along * lane.along_y
    phase = lane.sense * along / lane.radius + lane.phase
    return lane.x + lane.radius * math.cos(phase), lane.y + lane.radius * math.sin(phase)


@kernel
def heading_at(lane, along):
    """Return the direction of a lane at a coordinate along it, rad."""
    if lane.straight:
        return lane.heading
    return lane.sense * along / lane.radius + lane.phase + math.pi / 2 * lane.sense


@kernel
def on_lane(lane, x, y, margin):
    """Whether a point lies on a lane, widened on both sides, lengthened by a vehicle's length."""
    if abs(lateral(lane, x, y)) > LANE_WIDTH / 2 + margin:
        return False
    along = longitudinal(lane, x, y)
    return -VEHICLE_LENGTH <= along < lane.length + VEHICLE_LENGTH


@kernel
def closest_lane(x, y, heading, guess, tie):
    """Return the lane of least misfit: metres sideways and beyond the ends plus heading in rad.

    The guess only saves time: lanes that are too far sideways are not examined further, and on an
    arm of the road, where the next lane is at least 3 m away, no other lane is. Of lanes that are
    equally close, within `tie`, the first counts.
    """
    best = guess
    least = _misfit(guess, x, y, heading, math.inf)
    if least < _CLOSE and max(abs(x), abs(y)) > _OUTSIDE:
        return best
    for number in range(N_LANES):
        if number == guess:
            continue
        found = _misfit(number, x, y, heading, least + tie)
        if found < least - tie or (found <= least + tie and number < best):
            best, least = number, found
    return best


@kernel
def _misfit(number, x, y, heading, enough):
    """Return the distance to a lane; infinity as soon as it exceeds `enough`."""
    lane = LANES[number]
    found = abs(lateral(lane, x, y))
    if found > enough:
        return math.inf
    along = longitudinal(lane, x, y)
    found = found + max(along - lane.length, 0.0) + max(0.0 - along, 0.0)
    if found > enough:
        return math.inf
    return found + abs(wrap_to_pi(heading - heading_at(lane, along)))
