"""Choice of a lane by place, and the way from road to road."""

from __future__ import annotations

import math

from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import (
    LANE_WIDTH,
    VEHICLE_LENGTH,
    lateral,
    longitudinal,
    misfit,
    position,
    turned_misfit,
)


@kernel
def reachable(lane, x, y):
    """Whether a driver at a point may change to a lane."""
    if lane.forbidden or abs(lateral(lane, x, y)) > 2 * LANE_WIDTH:
        return False
    return 0 <= longitudinal(lane, x, y) < lane.length + VEHICLE_LENGTH


@kernel
def closest_lane(lanes, x, y, heading, guess):
    """Return the lane of least misfit plus heading in rad; the first of equals.

    The guess only saves time: lanes that are too far sideways are not examined further.
    """
    best = guess
    least = _boxed_misfit(lanes[guess], x, y, heading, math.inf)
    for number in range(len(lanes)):
        if number == guess:
            continue
        found = _boxed_misfit(lanes[number], x, y, heading, least)
        if found < least or (found == least and number < best):
            best, least = number, found
    return best


@kernel
def _boxed_misfit(lane, x, y, heading, enough):
    """Return `turned_misfit`, and infinity where the lane's box is too far.

    The misfit in place is the length of a way to the lane, so at least the distance to its box.
    """
    if (
        max(lane.low_x - x, x - lane.high_x) > enough
        or max(lane.low_y - y, y - lane.high_y) > enough
    ):
        return math.inf
    return turned_misfit(lane, x, y, heading, enough)


@kernel
def following(car, road):
    """Return the lane after a vehicle's target lane, by its way, else the closest; drop a leg."""
    lane = road.lanes[car.target_lane]
    wanted = _next_road(car, lane, road)
    x, y = position(lane, longitudinal(lane, car.x, car.y))
    if wanted >= 0:
        return _lane_of(wanted, lane, road.lanes, x, y)
    best, least = car.target_lane + 0, math.inf
    for place in range(road.successors.shape[1]):
        successor = road.successors[lane.road, place]
        if successor < 0:
            break
        found = _lane_of(successor, lane, road.lanes, x, y)
        away = misfit(road.lanes[found], x, y)
        if away < least:
            best, least = found, away
    return best


@kernel
def _next_road(car, lane, road):
    """Return the road by which a vehicle's way goes on, -1 if it has none."""
    if car.route < 0:
        return -1
    way = road.routes[car.route, car.destination]
    if car.leg < len(way) and way[car.leg] == lane.road:
        car.leg += 1
    if car.leg < len(way) and way[car.leg] >= 0:
        wanted = way[car.leg]
        for number in range(len(road.lanes)):
            if road.lanes[number].road == wanted:
                return wanted if road.lanes[number].start == lane.end else -1
    return -1


@kernel
def _lane_of(wanted, lane, lanes, x, y):
    """Return the lane of a road that a driver takes: of equal number, else the closest."""
    first = 0
    while lanes[first].road != wanted:
        first += 1
    if lanes[first].lanes == lane.lanes:
        return first + lane.number
    best, least = first, math.inf
    for number in range(first, first + lanes[first].lanes):
        away = misfit(lanes[number], x, y)
        if away < least:
            best, least = number, away
    return best
