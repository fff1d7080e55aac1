"""State of the intersection: records of its vehicles; `highway.state` has the arrays.

The vehicles of an episode are one row in highway-env's list order: those that entered before the
ego, the ego, those that entered later.
"""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway.scene import sight
from socialiq.worlds.highway.state import Buffers
from socialiq.worlds.intersection.options import Options

ACTIONS = ("slower", "idle", "faster")
"""Actions: one target speed down, keep, one up, counted from the present speed."""

SLOWER, IDLE, FASTER = range(len(ACTIONS))

SPEED_LIMIT = 10.0  # of every lane, m/s
POSITION_RANGE = 100.0  # m, seen as 1
SPEED_RANGE = 20.0  # m/s, seen as 1

SIGHT = sight(POSITION_RANGE, POSITION_RANGE, SPEED_RANGE, SPEED_RANGE, relative=False)
"""Scales of the observation; where the ego arrives, `core.traffic` says."""

VEHICLE = np.dtype(
    [
        ("x", np.float64),  # centre, m; x to the east, y to the south
        ("y", np.float64),
        ("heading", np.float64),  # rad, clockwise as drawn, from east
        ("along_x", np.float64),  # cosine and sine of the heading: its unit vector
        ("along_y", np.float64),
        ("speed", np.float64),  # m/s, negative in reverse
        ("steering", np.float64),  # held command: front wheel angle, rad
        ("acceleration", np.float64),  # held command, m/s²
        ("target_speed", np.float64),  # m/s; 0 while yielding
        ("desired_speed", np.float64),  # m/s; infinity: only the road's limit binds
        ("time_headway", np.float64),  # s
        ("jam_distance", np.float64),  # m
        ("max_acceleration", np.float64),  # m/s²
        ("comfort_deceleration", np.float64),  # m/s², positive
        ("exponent", np.float64),  # of the free-road term
        ("push_x", np.float64),  # m; displacement by a collision in the next sub-step
        ("push_y", np.float64),
        ("identity", np.int32),  # unique in its episode
        ("lane", np.int8),  # closest lane, 0 to 19
        ("target_lane", np.int8),  # lane it steers along
        ("origin", np.int8),  # arm it comes from, 0 to 3
        ("destination", np.int8),  # arm it leaves by
        ("leg", np.int8),  # completed legs of its route: 0 to 3
        ("yielding", np.bool_),
        ("crashed", np.bool_),
        ("pushed", np.bool_),  # push_x and push_y are pending
    ],
    align=True,
)
"""Vehicle record."""


def buffers_of(options: Options, size: int, traced: bool = False) -> Buffers:
    """Return empty buffers for `size` episodes, with space for every sub-step if traced."""
    return Buffers.of(options, VEHICLE, options.capacity, size, traced)
