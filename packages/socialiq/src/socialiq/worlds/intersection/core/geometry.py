"""The crossing as a table: twenty lanes of four arms, and who has priority.

Arms are numbered south 0, west 1, north 2, east 3. Each corner of highway-env's building loop makes
five lanes: the approach, the right turn, the left turn, the way straight on, and the exit of the
arm to its left-hand side. x grows to the east and y to the south, so headings grow clockwise.
"""

import math
from typing import Any

import numpy as np

from socialiq.worlds.highway.crossings import PAVEMENT, WAY
from socialiq.worlds.highway.network import APPROACH, EXIT, LANE_WIDTH, Lane, Network, arc, straight
from socialiq.worlds.highway.scenes import Road, Scene, road_of
from socialiq.worlds.intersection.options import ACTIONS, ALONG, SIGHT, SPEED_LIMIT
from socialiq.worlds.road_users import ON_FOOT, RIDES

N_LANES = 20
ACCESS_LENGTH = 100.0  # of approaches and exits, m
MIDDLE = 15.0  # m from the junction's centre to the middle of a crosswalk
BESIDE = 4.75  # m from the middle of the arm to that of a bicycle lane
RIDDEN = 30.0  # m of a bicycle lane before and behind the middle of the junction

# A lane's number is 5 * corner + its kind; APPROACH is 0, EXIT 4.
RIGHT = 1
LEFT = 2
STRAIGHT = 3


def _crossing() -> Road:
    right = LANE_WIDTH + 5.0
    half = LANE_WIDTH / 2
    left = right + LANE_WIDTH
    outer = right + half
    roads = Network()
    for corner in range(4):
        angle = math.radians(90 * corner)
        priority = 3 if corner % 2 else 1
        start = _turned(angle, half, ACCESS_LENGTH + outer)
        stop_line = _turned(angle, half, outer)
        across = _turned(angle, outer, outer)
        centre = _turned(angle, -left + half, left - half)
        exit_ends = _turned(angle, outer, half), _turned(angle, ACCESS_LENGTH + outer, half)
        turned = angle + math.pi
        bend = arc(across, right, turned, turned + math.radians(90), 1)
        wide_bend = arc(centre, left, angle, angle + math.radians(-90), -1)
        ahead = straight(stop_line, _turned(angle, half, -outer))
        before = f"in{corner}"
        arm = (corner - 1) % 4  # to the left-hand side
        roads.add(
            f"arm{corner}", before, Lane(straight(start, stop_line), APPROACH, False, priority)
        )
        roads.add(before, f"out{arm}", Lane(bend, RIGHT, False, priority))
        roads.add(before, f"out{(corner + 1) % 4}", Lane(wide_bend, LEFT, False, priority - 1))
        roads.add(before, f"out{(corner + 2) % 4}", Lane(ahead, STRAIGHT, False, priority))
        roads.add(f"out{arm}", f"arm{arm}", Lane(straight(*exit_ends), EXIT, False, priority))
    ways = [walk for arm in range(4) for walk in _crosswalk(arm)]
    ways += [_bicycle_lane(arm, outer) for arm in range(4)]
    return road_of(
        roads,
        SIGHT,
        destinations=[f"arm{arm}" for arm in range(4)],
        arrivals=[[lane] * 4 for lane in range(0, N_LANES, 5)],
        frames=[(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)],
        actions=ALONG,
        speed_limit=SPEED_LIMIT,
        ways=ways,
    )


_COS = 1.0, 0.0, -1.0, 0.0  # of the directions of the arms
_SIN = 0.0, 1.0, 0.0, -1.0  # of the directions of the arms


def _crosswalk(arm: int) -> list[np.ndarray]:
    """Return the ways of the crosswalk over an arm, back and forth."""
    half = LANE_WIDTH + PAVEMENT
    middle = -_SIN[arm] * MIDDLE, _COS[arm] * MIDDLE
    there, back = ((_COS[arm] * sense, _SIN[arm] * sense) for sense in (1, -1))
    headings = math.pi / 2 * (arm + 2), math.pi / 2 * arm
    shapes = zip(headings, (back, there), strict=True)
    return [
        np.array((ON_FOOT, *middle, heading, *along, half, half), WAY) for heading, along in shapes
    ]


def _bicycle_lane(arm: int, stop_line: float) -> np.ndarray:
    """Return the way of bicycles that come from an arm and ride straight on."""
    along = _SIN[arm], -_COS[arm]
    middle = _COS[arm] * BESIDE, _SIN[arm] * BESIDE
    heading = math.pi / 2 * (arm - 1)
    return np.array((RIDES, *middle, heading, *along, RIDDEN, stop_line), WAY)


def _turned(angle: float, x: float, y: float) -> tuple[float, float]:
    cos = math.cos(angle)
    sin = math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


ROAD = _crossing()
CROSSING = Scene(
    "intersection",
    ROAD,
    {},
    edge=float(ROAD.lanes["y"][STRAIGHT]),
    actions=ACTIONS,
    back_end="socialiq.worlds.intersection.reference:Reference",
)
LANES: Any = ROAD.lanes
"""Lanes in highway-env's order, which decides between equally close lanes."""

ROUTES = ROAD.routes[ROAD.arrivals[:, 0]]
"""Lanes of a route, by the arm of origin and the arm of exit; -1 after its end.

A route back to the arm of origin, which highway-env gives to some of several agents, turns at the
end of another exit.
"""
