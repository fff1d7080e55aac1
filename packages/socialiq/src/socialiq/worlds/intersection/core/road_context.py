"""Road-dependent quantities of the rewards for the simulator's twenty lanes."""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway.core import rewards
from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.core.geometry import distance, longitudinal, on_lane
from socialiq.worlds.highway.core.observation import observe
from socialiq.worlds.intersection.core.ego import arrived, route_coordinate
from socialiq.worlds.intersection.core.geometry import LANES
from socialiq.worlds.intersection.state import SIGHT


@kernel
def see(vehicles, count, ego, tie, observation):
    """Write the observation; coordinates are measured along the ego's lane."""
    lane = LANES[vehicles[ego].lane]
    along = np.empty(count)
    for slot in range(count):
        along[slot] = longitudinal(lane, vehicles[slot].x, vehicles[slot].y)
    observe(vehicles, count, ego, along, tie, SIGHT[0], observation)


@kernel
def ending_of(ego, out_of_time, settings):
    """Return the ending of the episode at this snapshot of the ego."""
    left = settings.offroad_terminal and not _on_road(ego)
    return rewards.ending_of(ego.crashed, left, arrived(ego), out_of_time)


@inlined_kernel
def write_signals(before, after, count, ego, start, ending, settings, signals, braking):
    """Write all signals of a decision.

    Args:
        before: VEHICLE records at the decision.
        after: The same vehicles in the same slots after the sub-steps.
        count: Number of vehicles.
        ego: The ego's slot.
        start: Route coordinate at which the ego began, m.
        ending: Value of `Ending`.
        settings: SETTINGS record.
        signals: In the order of `SIGNALS`, overwritten.
        braking: By slot, whether the loss of speed was charged to the ego; overwritten.
    """
    mine, reached = after[ego], route_coordinate(after[ego])
    advance = reached - route_coordinate(before[ego])
    rewards.env_signals(advance, _on_road(mine), mine.speed, ending, settings, signals)
    lane = LANES[mine.lane]
    along = longitudinal(lane, mine.x, mine.y)
    within = rewards.in_zone(mine.lane % 5, along, lane.length, reached - start, settings)
    counted, lost = np.empty(count, np.bool_), np.empty(count)
    for slot in range(count):
        other = after[slot]
        apart = distance(other.x, other.y, mine.x, mine.y)
        kind = other.target_lane % 5
        known = rewards.counts(apart, other.origin == mine.origin, kind, settings)
        counted[slot] = slot != ego and known
        lost[slot] = before[slot].speed - other.speed
    rewards.social_signals(mine.speed, within, counted, lost, ending, settings, signals, braking)


@inlined_kernel
def classical(before, after, count, ego, settings):
    """Return the rewards of the classical formulation (thesis A.1): ego and neighbours' mean."""
    on_road = np.empty(count, np.bool_)
    for slot in range(count):
        on_road[slot] = _on_road(after[slot])
    return rewards.classical(before, after, on_road, count, ego, settings)


@kernel
def _on_road(vehicle):
    return on_lane(LANES[vehicle.lane], vehicle.x, vehicle.y, 0.0)
