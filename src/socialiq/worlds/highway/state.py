"""State of a scene: records of vehicles, and the arrays that hold them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from socialiq.worlds.highway.scene import Road
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.settings import SIGNALS
from socialiq.worlds.intersection.state import EPISODE, FEATURES

ACTIONS = ("lane_left", "idle", "lane_right", "faster", "slower")
"""Actions: to the next lane, keep, or one target speed up or down from the present speed."""

LANE_LEFT, IDLE, LANE_RIGHT, FASTER, SLOWER = range(len(ACTIONS))

CAR = np.dtype(
    [
        ("x", np.float64),  # centre, m; x to the east, y to the south
        ("y", np.float64),
        ("heading", np.float64),  # rad, clockwise as drawn, from east
        ("along_x", np.float64),  # cosine and sine of the heading
        ("along_y", np.float64),
        ("speed", np.float64),  # m/s
        ("steering", np.float64),  # held command: front wheel angle, rad
        ("acceleration", np.float64),  # held command, m/s²
        ("target_speed", np.float64),
        ("time_headway", np.float64),  # s
        ("jam_distance", np.float64),  # m
        ("max_acceleration", np.float64),  # m/s²
        ("comfort_deceleration", np.float64),  # m/s², positive
        ("exponent", np.float64),  # of the free-road term
        ("timer", np.float64),  # s since the driver last thought of changing lanes
        ("push_x", np.float64),  # m; displacement by a collision in the next sub-step
        ("push_y", np.float64),
        ("identity", np.int32),  # its entry; obstacles follow
        ("lane", np.int16),  # closest lane
        ("target_lane", np.int16),  # lane it steers along
        ("route", np.int16),  # road at which its way began, -1 without a way
        ("destination", np.int16),
        ("leg", np.int16),  # completed roads of its way
        ("obstacle", np.bool_),
        ("crashed", np.bool_),
        ("pushed", np.bool_),  # push_x and push_y are pending
    ],
    align=True,
)
"""Record of a vehicle or of an obstacle, which stands and drives nowhere."""


class Buffers(NamedTuple):
    """Arrays that the core reads and writes, each with one row for an episode.

    Attributes:
        episodes: EPISODE records of the intersection; vehicles are never removed.
        cars: CAR records, vehicles in the order of their entry, then obstacles.
        before: `cars` at the last decision.
        reached: Observation of the state that the decision led to, float32.
        observation: Observation of the current state, which differs after a reset.
        signals: In the order of `SIGNALS`, unweighted.
        rewards: r_env and r_social, (batch, 2).
        speed: The ego's, m/s.
        ending: Values of `Ending`, int8.
        braking: Whether a vehicle's braking was charged to the ego, (batch, vehicles).
    """

    episodes: np.ndarray
    cars: np.ndarray
    before: np.ndarray
    reached: np.ndarray
    observation: np.ndarray
    signals: np.ndarray
    rewards: np.ndarray
    speed: np.ndarray
    ending: np.ndarray
    braking: np.ndarray

    @staticmethod
    def of(road: Road, options: Options, size: int) -> Buffers:
        """Return empty buffers for `size` episodes."""
        vehicles = len(road.entries)
        cars = size, vehicles + len(road.obstacles)
        seen = size, options.observed_vehicles, len(FEATURES)
        return Buffers(
            episodes=np.zeros(size, EPISODE),
            cars=np.zeros(cars, CAR),
            before=np.zeros(cars, CAR),
            reached=np.zeros(seen, np.float32),
            observation=np.zeros(seen, np.float32),
            signals=np.zeros((size, len(SIGNALS))),
            rewards=np.zeros((size, 2)),
            speed=np.zeros(size),
            ending=np.zeros(size, np.int8),
            braking=np.zeros((size, vehicles), np.bool_),
        )
