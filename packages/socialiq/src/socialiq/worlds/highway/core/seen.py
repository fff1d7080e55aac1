"""Observation and rewards of a scene: the signals of `rewards` on its lanes."""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway.core import observation, rewards
from socialiq.worlds.highway.core.compile import kernel
from socialiq.worlds.highway.core.geometry import distance, longitudinal, on_lane
from socialiq.worlds.highway.network import EXIT


@kernel
def observe(cars, road, seen):
    """Write the observation; coordinates are measured along the ego's lane, in slot 0.

    Obstacles have rows too.
    """
    lane = road.lanes[cars[0].lane]
    along = np.empty(len(cars))
    for slot in range(len(cars)):
        along[slot] = longitudinal(lane, cars[slot].x, cars[slot].y)
    observation.observe(cars, len(cars), 0, along, 0.0, road.sight[0], seen)


@kernel
def ending_of(ego, road, out_of_time):
    """Return the ending of the episode at this state of the ego."""
    lane = road.lanes[ego.lane]
    arrived = lane.kind == EXIT and longitudinal(lane, ego.x, ego.y) > road.sight[0].arrival
    return rewards.ending_of(ego.crashed, False, arrived, out_of_time)


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
    within = rewards.in_zone(lane.kind, along, lane.length, travelled, settings)
    origin = road.lanes[road.entries[0].lane].road
    counted, lost = np.empty(count, np.bool_), np.empty(count)
    for slot in range(count):
        other = after[slot]
        kind = road.lanes[other.target_lane].kind
        apart = distance(other.x, other.y, ego.x, ego.y)
        same = road.lanes[road.entries[slot].lane].road == origin
        counted[slot] = slot > 0 and rewards.counts(apart, same, kind, settings)
        lost[slot] = before[slot].speed - other.speed
    rewards.social_signals(ego.speed, within, counted, lost, ending, settings, signals, braking)


@kernel
def classical(before, after, count, road, settings):
    """Return the rewards of the classical formulation (thesis A.1): ego and neighbours' mean."""
    there = np.empty(count, np.bool_)
    for slot in range(count):
        car = after[slot]
        there[slot] = on_lane(road.lanes[car.lane], car.x, car.y, 0.0)
    return rewards.classical(before, after, there, count, 0, settings)
