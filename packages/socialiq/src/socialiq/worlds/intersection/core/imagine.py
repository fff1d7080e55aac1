"""Draw states that are consistent with an ego's observation, for online planning."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt64

from socialiq.types import Ending
from socialiq.worlds.highway.core import stream
from socialiq.worlds.highway.core.compile import (
    allocating_kernel,
    entry_point,
    fingerprint,
    kernel,
    run_in_parts,
)
from socialiq.worlds.highway.core.geometry import heading_at, lateral, longitudinal, wrap_to_pi
from socialiq.worlds.highway.core.vehicle import clip, speed_index
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.highway.options import EPISODE, FEATURES, Contact
from socialiq.worlds.highway.world import State
from socialiq.worlds.intersection.core.geometry import LANES, ROUTES, closest_lane
from socialiq.worlds.intersection.core.step import ENTRY_SPEED, draw_driver
from socialiq.worlds.intersection.core.traffic import enforce, follow_road, route_coordinate
from socialiq.worlds.intersection.options import (
    POSITION_RANGE,
    SPEED_LIMIT,
    SPEED_RANGE,
    VEHICLE,
    Options,
    settings_of,
)

HELD_BELOW = 5.0  # m/s; drivers get to their target speed within about a second
ROUTE_SCALE = 0.2  # m or rad of misfit by which one way across becomes e times less likely

_NO_CONTACT, _NO_ENDING = int(Contact.NONE), int(Ending.NONE)


@kernel
def _imagine(observation, episode, vehicles, settings):
    """Write a state with the given observation, as `imagined` says; the stream is seeded."""
    count = 0
    for row in range(len(observation)):
        if observation[row, 0] < 0.5:
            break
        vehicle = vehicles[row]
        _place(observation[row], vehicle, settings.tie)
        vehicle.identity = row
        _route(episode, vehicle, settings.destination if row == 0 else 0)
        if row == 0:
            vehicle.target_speed = settings.target_speeds[speed_index(vehicle.speed, settings)]
        else:
            draw_driver(episode, vehicle, settings)
            # A moving vehicle aims at its present speed. A held one that has not yielded yet aims
            # at its entry speed, one that has at the limit.
            if vehicle.speed > HELD_BELOW:
                vehicle.target_speed = min(vehicle.speed, SPEED_LIMIT)
            elif stream.uniform(episode) < 0.5:
                vehicle.target_speed = SPEED_LIMIT
            else:
                vehicle.target_speed = clip(ENTRY_SPEED + stream.normal(episode), 0.0, SPEED_LIMIT)
            vehicle.target_speed = min(vehicle.target_speed, vehicle.desired_speed)
        follow_road(vehicle)
        count += 1
    episode.time, episode.sub_steps, episode.vehicles = 0.0, settings.warm_up, count
    vehicles[0].agent, episode.controlled[0] = 0, 0
    episode.start[0], episode.next_identity = route_coordinate(vehicles[0], 0), count
    episode.contact[0], episode.touched[0], episode.ended[0] = _NO_CONTACT, -1, _NO_ENDING
    enforce(vehicles, count, settings)


@kernel
def _place(row, vehicle, tie):
    """Set a vehicle's observed pose and speed, and neutral values for everything else."""
    vehicle.x, vehicle.y = row[1] * POSITION_RANGE, row[2] * POSITION_RANGE
    vehicle.heading = math.atan2(row[6], row[5])
    vehicle.along_x, vehicle.along_y = math.cos(vehicle.heading), math.sin(vehicle.heading)
    vehicle.speed = (row[3] * vehicle.along_x + row[4] * vehicle.along_y) * SPEED_RANGE
    vehicle.steering, vehicle.acceleration, vehicle.desired_speed = 0.0, 0.0, math.inf
    vehicle.push_x, vehicle.push_y = 0.0, 0.0
    vehicle.lane = closest_lane(vehicle.x, vehicle.y, vehicle.heading, 0, tie)
    vehicle.yielding, vehicle.crashed, vehicle.pushed, vehicle.agent = False, False, False, -1


@allocating_kernel
def _route(episode, vehicle, destination):
    """Set origin, destination and leg by the lane; destination 0 is drawn.

    The less a way across fits the vehicle's pose, the less likely it is.
    """
    corner, kind = vehicle.lane // 5, vehicle.lane % 5
    vehicle.target_lane = vehicle.lane
    if kind == EXIT:
        vehicle.origin, vehicle.destination, vehicle.leg = (corner + 1) % 4, (corner + 3) % 4, 2
        return
    vehicle.origin, vehicle.leg = corner, 0 if kind == APPROACH else 1
    if destination == 0:
        weights = np.ones(3)  # of left, straight on and right, in the order of the arms
        if kind != APPROACH:
            for turn in range(3):
                lane = LANES[ROUTES[corner, (corner + 1 + turn) % 4, 1]]
                along = longitudinal(lane, vehicle.x, vehicle.y)
                misfit = abs(lateral(lane, vehicle.x, vehicle.y))
                misfit += abs(wrap_to_pi(vehicle.heading - heading_at(lane, along)))
                weights[turn] = math.exp(-misfit / ROUTE_SCALE)
        left, destination = stream.uniform(episode) * weights.sum(), 3
        for turn in range(2):
            left -= weights[turn]
            if left < 0:
                destination = 1 + turn
                break
    vehicle.destination = (corner + destination) % 4
    if kind != APPROACH:
        vehicle.target_lane = ROUTES[vehicle.origin, vehicle.destination, 1]


def _entry(sources: int):
    @entry_point
    def run(observations, entropy, episodes, vehicles, settings, first, end):
        for row in range(first, end):
            stream.seed(episodes[row], entropy[row])
            _imagine(observations[row], episodes[row], vehicles[row], settings[0])
        return sources

    return run


_run: Any = _entry(fingerprint(__file__))


def imagined(
    options: Options,
    observations: Float32[np.ndarray, "row feature"],
    entropy: UInt64[np.ndarray, " row"],
) -> State:
    """Draw one state for each observation, consistent with it.

    The destinations and parameters of the other vehicles and the later traffic are drawn, by a seed
    for each. Other unobserved quantities take their most likely value: there is no vehicle beyond
    the rows of the observation, no vehicle has crashed, the ego's target speed is the nearest to
    its speed, and the time limit is not reached.
    """
    rows = len(observations)
    rows_seen = np.ascontiguousarray(observations.reshape(rows, -1, len(FEATURES)))
    episodes = np.zeros(rows, EPISODE)
    vehicles = np.zeros((rows, options.capacity), VEHICLE)
    arguments = rows_seen, entropy, episodes, vehicles, settings_of(options)
    run_in_parts(_run, 0, rows, *arguments)
    return State(episodes, vehicles, rows_seen, np.zeros(rows, bool))
