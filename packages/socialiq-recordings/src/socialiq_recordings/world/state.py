"""State of the episodes of a recorded junction, and the results of their decisions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from socialiq.worlds.highway.settings import SIGNALS
from socialiq.worlds.highway.state import FEATURES
from socialiq_recordings.world.recorded_world import RecordedWorld

N_PARAMETERS = 6
"""Parameters of a driver; `drivers.Drivers`."""

AS_DRIVER = -1
"""Action with which the ego drives as a driver of the population."""


class Traffic(NamedTuple):
    """Episodes side by side; vehicles are numbered within the recording of their episode.

    Attributes:
        seed: Of the episode, uint64.
        recording: Number of the recording.
        ego: Number of the ego.
        step: Sub-steps since the recording's first frame.
        begun: Sub-step at which the episode began.
        n_present: Vehicles on the road.
        present: Their numbers, first those that came first, (row, vehicle).
        status: WAITING, PRESENT or GONE, (row, vehicle).
        along: Coordinates of their middles on their ways, m.
        speed: m/s.
        before: Speeds at the last decision, or since they entered, m/s.
        rate: Accelerations of the sub-step, m/s².
        barrier: Coordinate of the next leader or closed line, m.
        driver: Parameters, (row, vehicle, 6).
    """

    seed: np.ndarray
    recording: np.ndarray
    ego: np.ndarray
    step: np.ndarray
    begun: np.ndarray
    n_present: np.ndarray
    present: np.ndarray
    status: np.ndarray
    along: np.ndarray
    speed: np.ndarray
    before: np.ndarray
    rate: np.ndarray
    barrier: np.ndarray
    driver: np.ndarray

    @staticmethod
    def of(world: RecordedWorld, size: int) -> Traffic:
        """Return empty episodes."""
        rows, vehicles = (size,), (size, world.capacity)
        numbers = {name: np.zeros(rows, np.int64) for name in _NUMBERS}
        floats = {name: np.zeros(vehicles) for name in _FLOATS}
        return Traffic(
            seed=np.zeros(rows, np.uint64),
            **numbers,
            present=np.zeros(vehicles, np.int64),
            status=np.zeros(vehicles, np.int8),
            **floats,
            driver=np.zeros((*vehicles, N_PARAMETERS)),
        )


_NUMBERS = ("recording", "ego", "step", "begun", "n_present")
_FLOATS = ("along", "speed", "before", "rate", "barrier")


class Made(NamedTuple):
    """Results of a decision of every episode.

    Attributes:
        observation: Of the state reached, (row, vehicles seen, 7), float32.
        signals: In the order of `SIGNALS`, unweighted.
        pair: r_env and r_social, (row, 2).
        ending: Values of `Ending`, int8.
        speed: The ego's, m/s.
        contact: Values of `Contact`, int8: which vehicle struck, if the ego collided.
    """

    observation: np.ndarray
    signals: np.ndarray
    pair: np.ndarray
    ending: np.ndarray
    speed: np.ndarray
    contact: np.ndarray

    @staticmethod
    def of(world: RecordedWorld, size: int) -> Made:
        """Return empty results."""
        return Made(
            np.zeros((size, world.config.observed_vehicles, len(FEATURES)), np.float32),
            np.zeros((size, len(SIGNALS))),
            np.zeros((size, 2)),
            np.zeros(size, np.int8),
            np.zeros(size),
            np.zeros(size, np.int8),
        )
