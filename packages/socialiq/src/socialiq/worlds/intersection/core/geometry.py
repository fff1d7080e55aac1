"""Road: twenty lanes of a four-armed crossing, and its routes.

Arms are numbered south 0, west 1, north 2, east 3. Each corner of highway-env's building loop makes
five lanes: the approach, the right turn, the left turn, the way straight on, and the exit of the
arm to its left-hand side. x grows to the east and y to the south, so headings grow clockwise.
"""

import math
from typing import Any

import numpy as np

from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import LANE_WIDTH, turned_misfit
from socialiq.worlds.highway.network import APPROACH, EXIT, SHAPE, Shape, arc, straight

N_LANES = 20
ACCESS_LENGTH = 100.0  # of approaches and exits, m

RIGHT, LEFT, STRAIGHT = 1, 2, 3  # a lane's number is 5 * corner + its kind; APPROACH is 0, EXIT 4

LANE = np.dtype([*SHAPE, ("kind", np.int64), ("priority", np.int64)], align=True)
"""Lane record: a straight line or an arc of a circle."""


def _lanes() -> np.ndarray:
    right, half = LANE_WIDTH + 5.0, LANE_WIDTH / 2
    left, outer = right + LANE_WIDTH, right + half
    lanes = np.zeros(N_LANES, LANE)
    for corner in range(4):
        angle = math.radians(90 * corner)
        priority = 3 if corner % 2 else 1
        start, stop_line = _turned(angle, half, ACCESS_LENGTH + outer), _turned(angle, half, outer)
        across, centre = _turned(angle, outer, outer), _turned(angle, -left + half, left - half)
        exit_ends = _turned(angle, outer, half), _turned(angle, ACCESS_LENGTH + outer, half)
        turned = angle + math.pi
        shapes: dict[int, Shape] = {
            APPROACH: straight(start, stop_line),
            RIGHT: arc(across, right, turned, turned + math.radians(90), 1),
            LEFT: arc(centre, left, angle, angle + math.radians(-90), -1),
            STRAIGHT: straight(stop_line, _turned(angle, half, -outer)),
            EXIT: straight(*exit_ends),
        }
        for kind, shape in shapes.items():
            lane = lanes[5 * corner + kind]
            for name, value in shape.items():
                lane[name] = value
            lane["kind"], lane["priority"] = kind, priority - 1 if kind == LEFT else priority
    return lanes


def _turned(angle: float, x: float, y: float) -> tuple[float, float]:
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


LANES: Any = _lanes()
"""Lanes in highway-env's order, which decides between equally close lanes."""


_TURNS = {RIGHT: 3, LEFT: 1, STRAIGHT: 2}  # arms from that of origin to that of exit


def _routes() -> np.ndarray:
    routes = np.full((4, 4, 6), -1, np.int64)
    for origin in range(4):
        for kind, arms in _TURNS.items():
            arm = (origin + arms) % 4
            routes[origin, arm, :3] = 5 * origin, 5 * origin + kind, 5 * ((arm + 1) % 4) + EXIT
    for arm in range(4):  # back to it by way of the first arm in order of number that isn't it
        turning = 1 if arm == 0 else 0
        routes[arm, arm] = *routes[arm, turning, :3], *routes[turning, arm, :3]
    return routes


ROUTES = _routes()
"""Lanes of a route, by the arm of origin and the arm of exit; -1 after its end.

A route back to the arm of origin, which highway-env gives to some of several agents, turns at the
end of another exit.
"""

LEGS = (ROUTES >= 0).sum(axis=2)
"""Number of lanes of each route."""


def _connected() -> tuple[np.ndarray, np.ndarray]:
    following: list[list[int]] = []
    for number in range(N_LANES):
        corner, kind = divmod(number, 5)
        if kind == APPROACH:
            following.append([number + RIGHT, number + LEFT, number + STRAIGHT])
        elif kind == EXIT:
            following.append([5 * ((corner - 1) % 4)])
        else:
            following.append([int(ROUTES[corner, (corner + _TURNS[kind]) % 4, 2])])
    lanes, offsets = np.full((N_LANES, 5), -1, np.int64), np.zeros((N_LANES, 5))
    for number, ahead in enumerate(following):
        behind = [lane for lane, after in enumerate(following) if number in after]
        numbers = [number, *ahead, *behind]
        shift = [0.0] + [LANES[number]["length"]] * len(ahead)
        shift += [-LANES[lane_before]["length"] for lane_before in behind]
        lanes[number, : len(numbers)] = numbers
        offsets[number, : len(numbers)] = shift
    return lanes, offsets


CONNECTED, CONNECTED_OFFSETS = _connected()
"""Lanes on which a driver with connected lanes searches for a leader, in search order."""


_CLOSE = 1.0  # m; on an arm, no other lane is closer than this
_OUTSIDE = 15.0  # m from the centre; the junction's own lanes reach 11 m


@kernel
def closest_lane(x, y, heading, guess, tie):
    """Return the lane of least misfit: metres sideways and beyond the ends plus heading in rad.

    The guess only saves time: lanes that are too far sideways are not examined further, and on an
    arm of the road, where the next lane is at least 3 m away, no other lane is. Of lanes that are
    equally close, within `tie`, the first counts.
    """
    best = guess
    least = turned_misfit(LANES[guess], x, y, heading, math.inf)
    if least < _CLOSE and max(abs(x), abs(y)) > _OUTSIDE:
        return best
    for number in range(N_LANES):
        if number == guess:
            continue
        away = turned_misfit(LANES[number], x, y, heading, least + tie)
        if away < least - tie or (away <= least + tie and number < best):
            best, least = number, away
    return best
