"""Collisions of vehicles with one another and with obstacles."""

from __future__ import annotations

import math

import numpy as np

from socialiq.worlds.highway.core.collisions import (
    DIAGONAL,
    apart,
    corners_of,
    separate,
    who_struck,
)
from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH, distance

OBSTACLE = 2.0  # m, length and width
REACH = (DIAGONAL + math.sqrt(2 * OBSTACLE**2)) / 2


@kernel
def collide(cars, count, dt, contact, touched):
    """Mark what overlaps as crashed, and push apart what overlaps or will in a sub-step.

    Two vehicles are pushed by half each, a vehicle at an obstacle by the whole. A push takes
    effect, and marks the crash, in the next sub-step; the last push counts.

    Returns:
        The `Contact` of the ego, in slot 0, and the identity of what it touched; as given if none.
    """
    intact = not cars[0].crashed
    for first in range(count):
        one = cars[first]
        for second in range(first + 1, len(cars)):
            other = cars[second]
            reach = REACH if other.obstacle else DIAGONAL
            if distance(other.x, other.y, one.x, one.y) > reach + one.speed * dt:
                continue
            if other.obstacle:
                overlap, will_overlap, push_x, push_y = _at_obstacle(one, other, dt)
                if will_overlap:
                    one.push_x, one.push_y, one.pushed = push_x, push_y, True
            else:
                overlap, will_overlap, push_x, push_y = separate(one, other, dt, 0.0)
                if will_overlap:
                    one.push_x, one.push_y, one.pushed = push_x / 2, push_y / 2, True
                    other.push_x, other.push_y, other.pushed = -push_x / 2, -push_y / 2, True
            if overlap:
                one.crashed = True
                other.crashed = True
            if intact and first == 0 and (overlap or will_overlap):
                contact, touched = who_struck(one, other), other.identity
    return contact, touched


@kernel
def _at_obstacle(car, obstacle, dt):
    mine, theirs = np.empty((4, 2)), np.empty((4, 2))
    corners_of(car, VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2, mine)
    corners_of(obstacle, OBSTACLE / 2, OBSTACLE / 2, theirs)
    ahead_x, ahead_y = car.speed * car.along_x * dt, car.speed * car.along_y * dt
    return apart(mine, theirs, ahead_x, ahead_y, 0.0)
