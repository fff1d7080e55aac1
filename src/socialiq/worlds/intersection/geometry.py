"""The road: twenty lanes of a four-armed crossing, and coordinates along them.

Arms are numbered south 0, west 1, north 2, east 3. Each corner of highway-env's building loop makes
five lanes: the approach, the right turn, the left turn, the way straight on, and the exit of the
arm to its left-hand side. x grows to the east and y to the south, so headings grow clockwise.
"""

from __future__ import annotations

import math

import numpy as np

from socialiq.worlds.intersection.compile import kernel

N_LANES = 20
LANE_WIDTH = 4.0
ACCESS_LENGTH = 100.0  # of approaches and exits, m
SPEED_LIMIT = 10.0  # of every lane, m/s
VEHICLE_LENGTH = 5.0
VEHICLE_WIDTH = 2.0

APPROACH, RIGHT, LEFT, STRAIGHT, EXIT = range(5)  # a lane's number is 5 * corner + its kind

MOST_NEIGHBOURS = 4

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
"""One lane: a straight line or an arc of a circle."""


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


LANES = _lanes()
"""The lanes in highway-env's order, which decides between equally close ones."""
