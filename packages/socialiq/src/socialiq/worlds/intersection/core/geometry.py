"""Road: twenty lanes of a four-armed crossing, and its routes.

Arms are numbered south 0, west 1, north 2, east 3. Each corner of highway-env's building loop makes
five lanes: the approach, the right turn, the left turn, the way straight on, and the exit of the
arm to its left-hand side. x grows to the east and y to the south, so headings grow clockwise.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import LANE_WIDTH, turned_misfit
from socialiq.worlds.highway.network import APPROACH, EXIT, SHAPE, Shape, arc, straight
from socialiq.worlds.intersection.options import (
    SPEED_LIMIT as SPEED_LIMIT,  # kernels read it from here
)

N_LANES = 20
ACCESS_LENGTH = 100.0  # of approaches and exits, m

RIGHT, LEFT, STRAIGHT = 1, 2, 3  # a lane's number is 5 * corner + its kind; APPROACH is 0, EXIT 4

LANE = np.dtype([*SHAPE, ("priority", np.int64)], align=True)
"""Lane record: a straight line or an arc of a circle."""


def _lanes() -> np.ndarray:
    right, half = LANE_WIDTH + 5.0, LANE_WIDTH / 2
    left = right + LANE_WIDTH
    outer = right + half
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
            lane["priority"] = priority - 1 if kind == LEFT else priority
    return lanes


def _turned(angle: float, x: float, y: float) -> tuple[float, float]:
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


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
        following = _following(lane)
        preceding = [number for number in range(N_LANES) if lane in _following(number)]
        numbers = [lane, *following, *preceding]
        shift = [0.0] + [LANES[lane]["length"]] * len(following)
        shift += [-LANES[lane_before]["length"] for lane_before in preceding]
        lanes[lane, : len(numbers)] = numbers
        offsets[lane, : len(numbers)] = shift
    return lanes, offsets


def _following(lane: int) -> list[int]:
    corner, kind = divmod(lane, 5)
    if kind == APPROACH:
        return [lane + RIGHT, lane + LEFT, lane + STRAIGHT]
    if kind == EXIT:
        return [5 * ((corner - 1) % 4)]
    return [exit_of((corner + {RIGHT: 3, LEFT: 1, STRAIGHT: 2}[kind]) % 4)]


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
