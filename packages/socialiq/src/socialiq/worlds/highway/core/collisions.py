"""Collisions of vehicles with one another and with obstacles, by separating axes."""

from __future__ import annotations

import math

import numpy as np

from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH, distance
from socialiq.worlds.highway.state import Contact

DIAGONAL = math.sqrt(VEHICLE_LENGTH**2 + VEHICLE_WIDTH**2)
OBSTACLE = 2.0  # m, length and width
_REACH = (DIAGONAL + math.sqrt(2 * OBSTACLE**2)) / 2

_NONE = int(Contact.NONE)
_EGO_STRUCK = int(Contact.EGO_STRUCK)
_EGO_WAS_STRUCK = int(Contact.EGO_WAS_STRUCK)


@kernel
def collide(vehicles, count, records, ego, dt, tie, contact, touched):
    """Mark what overlaps as crashed, and push apart what overlaps or will in a sub-step.

    Two vehicles are pushed by half each, a vehicle at an obstacle by the whole. A push takes
    effect, and marks the crash, in the next sub-step; the last push of a vehicle counts.

    Args:
        vehicles: Records of vehicles, then of obstacles.
        count: Number of vehicles.
        records: Number of records.
        ego: The ego's slot, -1 without one.
        dt: s of the sub-step.
        tie: Depths closer than this are equal, m.
        contact: Last `Contact` of the ego.
        touched: Identity of what it touched.

    Returns:
        The ego's `Contact` and the identity of what it touched; as given if nothing.
    """
    intact = ego >= 0 and not vehicles[ego].crashed
    for first in range(count):
        car = vehicles[first]
        for second in range(first + 1, records):
            partner = vehicles[second]
            reach = _REACH if second >= count else DIAGONAL
            if distance(partner.x, partner.y, car.x, car.y) > reach + car.speed * dt:
                continue
            if second >= count:
                overlap, will_overlap, push_x, push_y = _at_obstacle(car, partner, dt)
                if will_overlap:
                    car.push_x, car.push_y, car.pushed = push_x, push_y, True
            else:
                overlap, will_overlap, push_x, push_y = separate(car, partner, dt, tie)
                if will_overlap:
                    car.push_x, car.push_y, car.pushed = push_x / 2, push_y / 2, True
                    partner.push_x, partner.push_y, partner.pushed = -push_x / 2, -push_y / 2, True
            if overlap:
                car.crashed = True
                partner.crashed = True
            if intact and (overlap or will_overlap) and (first == ego or second == ego):
                touching = partner if first == ego else car
                contact, touched = who_struck(vehicles[ego], touching), touching.identity
    return contact, touched


@kernel
def _at_obstacle(car, obstacle, dt):
    corners, square = np.empty((4, 2)), np.empty((4, 2))
    corners_of(car, VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2, corners)
    corners_of(obstacle, OBSTACLE / 2, OBSTACLE / 2, square)
    ahead_x, ahead_y = car.speed * car.along_x * dt, car.speed * car.along_y * dt
    return apart(corners, square, ahead_x, ahead_y, 0.0)


@kernel
def contact_of(vehicles, ego, dt, contact, touched):
    """Return the ego's contact after a sub-step, with pairs in the order of `collide`."""
    for slot in range(len(vehicles)):
        if slot == ego:
            continue
        car, partner = vehicles[min(slot, ego)], vehicles[max(slot, ego)]
        if distance(partner.x, partner.y, car.x, car.y) > DIAGONAL + car.speed * dt:
            continue
        overlap, will_overlap, _, _ = separate(car, partner, dt, 0.0)
        if overlap or will_overlap:
            contact, touched = who_struck(vehicles[ego], vehicles[slot]), vehicles[slot].identity
    return contact, touched


@kernel
def who_struck(ego, other):
    """Return the `Contact` by which vehicle's motion closed the gap between the centres."""
    dx, dy = other.x - ego.x, other.y - ego.y
    ego_closes = ego.speed * (ego.along_x * dx + ego.along_y * dy)
    other_closes = -other.speed * (other.along_x * dx + other.along_y * dy)
    return _EGO_STRUCK if ego_closes >= other_closes else _EGO_WAS_STRUCK


@kernel
def separate(one, other, dt, tie):
    """Separating-axis test of two rectangles.

    Returns:
        Whether they overlap, whether they will within `dt` at their speeds, and the shortest
        displacement (x, y) of the first that would separate them then.
    """
    corners, other_corners = np.empty((4, 2)), np.empty((4, 2))
    corners_of(one, VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2, corners)
    corners_of(other, VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2, other_corners)
    relative_x = one.speed * one.along_x * dt - other.speed * other.along_x * dt
    relative_y = one.speed * one.along_y * dt - other.speed * other.along_y * dt
    return apart(corners, other_corners, relative_x, relative_y, tie)


@kernel
def apart(mine, theirs, relative_x, relative_y, tie):
    """Separating-axis test of two rectangles' corners; `separate` says what it returns.

    Args:
        mine: Corners of the first, (4, 2).
        theirs: Corners of the second.
        relative_x: Motion of the first against the second in the time ahead, m.
        relative_y: Likewise.
        tie: Depths closer than this are equal, m.
    """
    between_x = _mean(mine, 0) - _mean(theirs, 0)
    between_y = _mean(mine, 1) - _mean(theirs, 1)
    overlap, will_overlap = True, True
    least, axis_x, axis_y = math.inf, 0.0, 0.0
    for side in range(8):
        corners = mine if side < 4 else theirs
        here, there = side % 4, (side + 1) % 4
        normal_x = -corners[there, 1] + corners[here, 1]
        normal_y = corners[there, 0] - corners[here, 0]
        length = math.sqrt(normal_x * normal_x + normal_y * normal_y)
        normal_x /= length
        normal_y /= length
        low, high = _project(mine, normal_x, normal_y)
        other_low, other_high = _project(theirs, normal_x, normal_y)
        if _gap(low, high, other_low, other_high) > 0:
            overlap = False
        approach = normal_x * relative_x + normal_y * relative_y
        if approach < 0:
            low += approach
        else:
            high += approach
        gap = _gap(low, high, other_low, other_high)
        if gap > 0:
            will_overlap = False
        if not overlap and not will_overlap:
            return False, False, 0.0, 0.0
        if abs(gap) < least - tie:
            least = abs(gap)
            away = between_x * normal_x + between_y * normal_y > 0
            axis_x = normal_x if away else -normal_x
            axis_y = normal_y if away else -normal_y
    return overlap, will_overlap, least * axis_x, least * axis_y


@kernel
def corners_of(one, long, wide, corners):
    """Write the corners of a rectangle, (4, 2), by its half length and half width, m."""
    for corner in range(4):
        along = -long if corner < 2 else long
        across = wide if corner == 1 or corner == 2 else -wide
        corners[corner, 0] = one.along_x * along - one.along_y * across + one.x
        corners[corner, 1] = one.along_y * along + one.along_x * across + one.y


@kernel
def _mean(corners, axis):
    return (corners[0, axis] + corners[1, axis] + corners[2, axis] + corners[3, axis]) / 4


@kernel
def _project(corners, normal_x, normal_y):
    low, high = math.inf, -math.inf
    for corner in range(4):
        along = corners[corner, 0] * normal_x + corners[corner, 1] * normal_y
        low = min(low, along)
        high = max(high, along)
    return low, high


@kernel
def _gap(low, high, other_low, other_high):
    """Return the distance of two intervals, negative if they overlap."""
    if low < other_low:
        return other_low - high
    return low - other_high
