"""Collisions of vehicles with one another and with obstacles."""

from __future__ import annotations

import math

import numpy as np

from socialiq.worlds.intersection.core.collisions import DIAGONAL, apart, separate
from socialiq.worlds.intersection.core.compile import kernel
from socialiq.worlds.intersection.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH, distance

OBSTACLE = 2.0  # m, length and width
REACH = (DIAGONAL + math.sqrt(2 * OBSTACLE**2)) / 2


@kernel
def collide(cars, count, dt):
    """Mark what overlaps as crashed, and push apart what overlaps or will in a sub-step.

    Two vehicles are pushed by half each, a vehicle at an obstacle by the whole. A push takes
    effect, and marks the crash, in the next sub-step; the last push counts.
    """
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


@kernel
def _at_obstacle(car, obstacle, dt):
    mine, theirs = np.empty((4, 2)), np.empty((4, 2))
    _corners(car, VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2, mine)
    _corners(obstacle, OBSTACLE / 2, OBSTACLE / 2, theirs)
    ahead_x, ahead_y = car.speed * car.along_x * dt, car.speed * car.along_y * dt
    return apart(mine, theirs, ahead_x, ahead_y, 0.0)


@kernel
def _corners(one, long, wide, corners):
    """Write the corners of a rectangle, by its half length and half width."""
    for corner in range(4):
        along = -long if corner < 2 else long
        across = wide if corner == 1 or corner == 2 else -wide
        corners[corner, 0] = one.along_x * along - one.along_y * across + one.x
        corners[corner, 1] = one.along_y * along + one.along_x * across + one.y
