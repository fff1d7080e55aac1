"""Observation and rewards of a scene: the intersection's signals on other roads."""

from __future__ import annotations

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core.lanes import on_lane
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.intersection.core import rewards
from socialiq.worlds.intersection.core.compile import kernel
from socialiq.worlds.intersection.core.geometry import (
    APPROACH,
    STRAIGHT,
    VEHICLE_LENGTH,
    distance,
    longitudinal,
)
from socialiq.worlds.intersection.core.geometry import EXIT as EXIT_LANE
from socialiq.worlds.intersection.core.observation import PERCEPTION
from socialiq.worlds.intersection.core.traffic import clip

_NONE = int(Ending.NONE)
_KINDS = np.array([APPROACH, STRAIGHT, EXIT_LANE])  # by the kind of a scene's lane


@kernel
def observe(cars, road, observation):
    """Write the ego's row, then those of others by distance along the ego's lane.

    What is more than 10 m behind or 200 m away is not observed. Obstacles have rows too.
    """
    observation[:] = 0.0
    sight, ego = road.sight[0], cars[0]
    _write(ego, 0.0, 0.0, 0.0, 0.0, sight, observation[0])
    lane = road.lanes[ego.lane]
    here = longitudinal(lane, ego.x, ego.y)
    slots, distances, seen = np.empty(len(cars), np.int64), np.empty(len(cars)), 0
    for slot in range(1, len(cars)):
        other = cars[slot]
        if not distance(other.x, other.y, ego.x, ego.y) < PERCEPTION:
            continue
        ahead = longitudinal(lane, other.x, other.y) - here
        if not ahead > -2 * VEHICLE_LENGTH:
            continue
        place = seen
        while place > 0 and distances[place - 1] > abs(ahead):
            slots[place], distances[place] = slots[place - 1], distances[place - 1]
            place -= 1
        slots[place], distances[place] = slot, abs(ahead)
        seen += 1
    x, y, vx, vy = 0.0, 0.0, 0.0, 0.0
    if sight.relative:
        x, y, vx, vy = ego.x, ego.y, ego.speed * ego.along_x, ego.speed * ego.along_y
    for row in range(min(seen, len(observation) - 1)):
        _write(cars[slots[row]], x, y, vx, vy, sight, observation[row + 1])


@kernel
def _write(car, x, y, vx, vy, sight, row):
    row[0] = 1.0
    row[1] = _scaled(car.x - x, sight.x)
    row[2] = _scaled(car.y - y, sight.y)
    row[3] = _scaled(car.speed * car.along_x - vx, sight.vx)
    row[4] = _scaled(car.speed * car.along_y - vy, sight.vy)
    row[5] = car.along_x
    row[6] = car.along_y


@kernel
def _scaled(value, bound):
    """Map [-bound, bound] to [-1, 1], and clip."""
    return clip(-1.0 + (value + bound) * 2.0 / (2.0 * bound), -1.0, 1.0)


@kernel
def ending_of(ego, road, out_of_time):
    """Return the ending of the episode at this state of the ego."""
    lane = road.lanes[ego.lane]
    arrived = lane.kind == EXIT and longitudinal(lane, ego.x, ego.y) > road.sight[0].arrival
    return rewards.ending_of(ego.crashed, arrived, out_of_time)


@kernel
def coordinate(car, road):
    """Return the metres of the task up to a vehicle, by the first lane of its target road."""
    lane = road.lanes[car.target_lane]
    along = longitudinal(lane, car.x, car.y)
    return lane.before + along * (road.lanes[lane.first].length / lane.length)


@kernel
def write_signals(before, after, count, start, ending, road, settings, signals, braking):
    """Write all signals of a decision; the ego is in slot 0 (`rewards`)."""
    ego = after[0]
    reached = coordinate(ego, road)
    lane = road.lanes[ego.lane]
    there = on_lane(lane, ego.x, ego.y, 0.0)
    advance = reached - coordinate(before[0], road)
    rewards.env_signals(advance, there, ego.speed, ending, settings, signals)
    along = longitudinal(lane, ego.x, ego.y)
    travelled = reached - start
    within = rewards.in_zone(_KINDS[lane.kind], along, lane.length, travelled, settings)
    origin = road.lanes[road.entries[0].lane].road
    counted, lost = np.empty(count, np.bool_), np.empty(count)
    for slot in range(count):
        other = after[slot]
        kind = _KINDS[road.lanes[other.target_lane].kind]
        apart = distance(other.x, other.y, ego.x, ego.y)
        same = road.lanes[road.entries[slot].lane].road == origin
        counted[slot] = slot > 0 and rewards.counts(apart, same, kind, settings)
        lost[slot] = before[slot].speed - other.speed
    rewards.social_signals(ego.speed, within, counted, lost, ending, settings, signals, braking)
