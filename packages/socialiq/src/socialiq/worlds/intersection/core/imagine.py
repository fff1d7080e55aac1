"""Draw states that are consistent with an ego's observation, for online planning."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt64

from socialiq.types import Ending
from socialiq.worlds.highway.batch import State
from socialiq.worlds.highway.core import stream
from socialiq.worlds.highway.core.compile import (
    allocating_kernel,
    entry_point,
    fingerprint,
    kernel,
    run_in_parts,
)
from socialiq.worlds.highway.core.drivers import coordinate, follow_road
from socialiq.worlds.highway.core.geometry import (
    closest_lane,
    heading_at,
    lateral,
    longitudinal,
    wrap_to_pi,
)
from socialiq.worlds.highway.core.priority import enforce
from socialiq.worlds.highway.core.traffic import ENTRY_SPEED, draw_driver
from socialiq.worlds.highway.core.vehicle import clip, speed_index
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.highway.options import EPISODE, FEATURES, VEHICLE, Contact, settings_of
from socialiq.worlds.intersection.core.geometry import ROAD
from socialiq.worlds.intersection.options import (
    POSITION_RANGE,
    SPEED_LIMIT,
    SPEED_RANGE,
    Options,
)
from socialiq.worlds.road_users import PERSON

HELD_BELOW = 5.0  # m/s; drivers get to their target speed within about a second
ROUTE_SCALE = 0.2  # m or rad of misfit by which one way across becomes e times less likely

_NO_CONTACT = int(Contact.NONE)
_NO_ENDING = int(Ending.NONE)


@kernel
def _imagine(observation, episode, vehicles, road, settings):
    """Write a state with the given observation, as `imagined` says; the stream is seeded."""
    count = 0
    for row in range(len(observation)):
        if observation[row, 0] < 0.5:
            break
        vehicle = vehicles[row]
        _place(observation[row], vehicle, road, settings.tie)
        vehicle.identity = row
        _route(episode, vehicle, settings.destination if row == 0 else 0, road)
        if row == 0:
            vehicle.target_speed = settings.target_speeds[speed_index(vehicle.speed, settings)]
        else:
            draw_driver(episode, vehicle, True, settings)
            # A moving vehicle aims at its present speed. A held one that has not yielded yet aims
            # at its entry speed, one that has at the limit.
            if vehicle.speed > HELD_BELOW:
                vehicle.target_speed = min(vehicle.speed, SPEED_LIMIT)
            elif stream.uniform(episode) < 0.5:
                vehicle.target_speed = SPEED_LIMIT
            else:
                vehicle.target_speed = clip(ENTRY_SPEED + stream.normal(episode), 0.0, SPEED_LIMIT)
            vehicle.target_speed = min(vehicle.target_speed, vehicle.desired_speed)
        follow_road(vehicle, road)
        count += 1
    episode.time = 0.0
    episode.sub_steps = settings.warm_up
    episode.vehicles = count
    vehicles[0].agent = 0
    episode.controlled[0] = 0
    episode.start[0] = coordinate(vehicles[0], road)
    episode.next_identity = count
    episode.contact[0] = _NO_CONTACT
    episode.touched[0] = -1
    episode.ended[0] = _NO_ENDING
    enforce(vehicles, count, road, settings)


@kernel
def _place(row, vehicle, road, tie):
    """Set a vehicle's observed pose and speed, and neutral values for everything else."""
    vehicle.x = row[1] * POSITION_RANGE
    vehicle.y = row[2] * POSITION_RANGE
    vehicle.heading = math.atan2(row[6], row[5])
    vehicle.along_x = math.cos(vehicle.heading)
    vehicle.along_y = math.sin(vehicle.heading)
    vehicle.speed = (row[3] * vehicle.along_x + row[4] * vehicle.along_y) * SPEED_RANGE
    vehicle.steering = 0.0
    vehicle.acceleration = 0.0
    vehicle.desired_speed = math.inf
    vehicle.push_x = 0.0
    vehicle.push_y = 0.0
    vehicle.lane = closest_lane(road.lanes, vehicle.x, vehicle.y, vehicle.heading, 0, tie)
    vehicle.yielding = False
    vehicle.crashed = False
    vehicle.pushed = False
    vehicle.agent = -1


@allocating_kernel
def _route(episode, vehicle, destination, road):
    """Set origin, destination and leg by the lane; destination 0 is drawn.

    The less a way across fits the vehicle's pose, the less likely it is.
    """
    corner = vehicle.lane // 5
    kind = vehicle.lane % 5
    vehicle.target_lane = vehicle.lane
    if kind == EXIT:
        vehicle.origin = (corner + 1) % 4
        vehicle.destination = (corner + 3) % 4
        vehicle.leg = 2
        vehicle.route = road.arrivals[vehicle.origin, 0]
        return
    vehicle.origin = corner
    vehicle.route = road.arrivals[corner, 0]
    vehicle.leg = 0 if kind == APPROACH else 1
    if destination == 0:
        weights = np.ones(3)  # of left, straight on and right, in the order of the arms
        if kind != APPROACH:
            for turn in range(3):
                lane = road.lanes[road.routes[vehicle.route, (corner + 1 + turn) % 4, 1]]
                along = longitudinal(lane, vehicle.x, vehicle.y)
                misfit = abs(lateral(lane, vehicle.x, vehicle.y))
                misfit += abs(wrap_to_pi(vehicle.heading - heading_at(lane, along)))
                weights[turn] = math.exp(-misfit / ROUTE_SCALE)
        left = stream.uniform(episode) * weights.sum()
        destination = 3
        for turn in range(2):
            left -= weights[turn]
            if left < 0:
                destination = 1 + turn
                break
    vehicle.destination = (corner + destination) % 4
    if kind != APPROACH:
        vehicle.target_lane = road.routes[vehicle.route, vehicle.destination, 1]


def _entry(sources: int):
    @entry_point
    def run(observations, entropy, episodes, vehicles, road, settings, first, end):
        for row in range(first, end):
            stream.seed(episodes[row], entropy[row])
            _imagine(observations[row], episodes[row], vehicles[row], road, settings[0])
        return sources

    return run


_run: Any = _entry(fingerprint(__file__))


def imagined(
    options: Options,
    observations: Float32[np.ndarray, "row feature"],
    entropy: UInt64[np.ndarray, " row"],
) -> State:
    """Draw one state for each observation, consistent with it.

    The destinations and parameters of all vehicles except the ego and the later traffic are drawn.
    Unobserved quantities that are not drawn take their most likely value: there is no vehicle
    beyond the rows of the observation, no vehicle has crashed, the ego's target speed is the
    nearest to its speed, and the time limit is not reached.

    Args:
        options: Options of the scenario; the ego's destination is drawn too if it is "random".
        observations: Observations without the time.
        entropy: Seed of each state.

    Returns:
        A state with a row for each observation, at time 0.
    """
    rows = len(observations)
    rows_seen = np.ascontiguousarray(observations.reshape(rows, -1, len(FEATURES)))
    episodes = np.zeros(rows, EPISODE)
    vehicles = np.zeros((rows, options.capacity), VEHICLE)
    arguments = rows_seen, entropy, episodes, vehicles, ROAD, settings_of(options)
    run_in_parts(_run, 0, rows, *arguments)
    people = np.zeros((rows, options.persons), PERSON)
    return State(episodes, vehicles, people, rows_seen, np.zeros(rows, bool))
