"""State of a road: records of episodes, and the arrays that hold them.

A state is two arrays, of episodes and of vehicles, so copying them saves it, and copying them back
restores it to the last bit, random stream included.
"""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.worlds.highway.options import SIGNALS, RoadOptions

MAX_SPEED = 40.0  # m/s of any vehicle, either way

FEATURES = ("presence", "x", "y", "vx", "vy", "cos_h", "sin_h")
"""Numbers of one row of the observation."""


MOTION = [
    ("x", np.float64),  # centre, m; x to the east, y to the south
    ("y", np.float64),
    ("heading", np.float64),  # rad, clockwise as drawn, from east
    ("along_x", np.float64),  # cosine and sine of the heading: its unit vector
    ("along_y", np.float64),
    ("speed", np.float64),  # m/s, negative in reverse
    ("steering", np.float64),  # held command: front wheel angle, rad
    ("acceleration", np.float64),  # held command, m/s²
    ("target_speed", np.float64),  # m/s
]
DRIVER = [
    ("time_headway", np.float64),  # s
    ("jam_distance", np.float64),  # m
    ("max_acceleration", np.float64),  # m/s²
    ("comfort_deceleration", np.float64),  # m/s², positive
    ("exponent", np.float64),  # of the free-road term
]
PUSH = [("push_x", np.float64), ("push_y", np.float64)]  # m, by a collision, in the next sub-step
FLAGS = [("crashed", np.bool_), ("pushed", np.bool_)]  # a push is pending
"""Fields of the records of vehicles of all roads."""


class Contact(enum.IntEnum):
    """Vehicle that struck the other, by whose motion closed the gap: the ego's or the other's."""

    NONE = 0
    EGO_STRUCK = 1
    EGO_WAS_STRUCK = 2


EPISODE = np.dtype(
    [
        ("state_high", np.uint64),  # PCG64: 128 bits of state and of increment
        ("state_low", np.uint64),
        ("increment_high", np.uint64),
        ("increment_low", np.uint64),
        ("half_word", np.uint64),  # the 32 bits that a bounded draw left over
        ("has_half_word", np.bool_),
        ("time", np.float64),  # s since the reset
        ("sub_steps", np.int64),  # of the road, warm-up included; schedules the rules
        ("vehicles", np.int64),  # slots in use
        ("ego", np.int64),  # the ego's slot
        ("start", np.float64),  # route coordinate at which the ego began, m
        ("next_identity", np.int32),
        ("contact", np.int8),  # last Contact of the ego: which vehicle struck
        ("touched", np.int32),  # identity of the vehicle that it touched, -1 if none
    ],
    align=True,
)
"""Episode record."""


RESET, DECIDE, DECIDE_AND_RESET, ANNOTATE, SKIP = range(5)
"""Commands for an episode. ANNOTATE computes a decision's results from given snapshots."""


class Buffers(NamedTuple):
    """Arrays that an engine reads and writes, each with one row for an episode."""

    episodes: np.ndarray  # EPISODE records, shape (batch,)
    vehicles: np.ndarray  # current records of vehicles, (batch, capacity)
    before: np.ndarray  # vehicles at the last decision, (batch, capacity)
    after: np.ndarray  # vehicles after the sub-steps of that decision, (batch, capacity)
    # number of vehicles in `before` and `after`, and the ego's slot, (batch, 2)
    present: np.ndarray
    reached: np.ndarray  # observation of the state that the decision led to, float32
    observation: np.ndarray  # observation of the current state, which differs after a reset
    signals: np.ndarray  # in the order of `SIGNALS`, unweighted
    rewards: np.ndarray  # r_env and r_social, (batch, 2)
    classical: np.ndarray  # the ego's own reward and its neighbours' mean (thesis A.1), (batch, 2)
    speed: np.ndarray  # the ego's, m/s
    ending: np.ndarray  # values of `Ending`, int8
    contact: np.ndarray  # values of `Contact`, int8: which vehicle struck, if the ego collided
    neighbours_collided: np.ndarray  # number of other vehicles that collided with each other
    braking: np.ndarray  # whether a vehicle's braking was charged to the ego, (batch, capacity)
    # vehicles after each sub-step, (batch, frames, capacity); empty if not traced
    trace: np.ndarray

    @staticmethod
    def of(
        options: RoadOptions, kind: np.dtype, most: int, size: int, traced: bool = False
    ) -> Buffers:
        """Return empty buffers.

        Args:
            options: Options of the road.
            kind: Record of one vehicle.
            most: Largest number of vehicles of an episode.
            size: Number of episodes.
            traced: Whether there is space for every sub-step.

        Raises:
            UserError: If the size is not positive.
        """
        if size < 1:
            raise UserError(f"size must be at least 1, got {size}")
        rows, capacity = (size,), (size, most)
        observed = (size, options.observed_vehicles, len(FEATURES))
        frames = (size if traced else 0, options.frames, most)
        return Buffers(
            episodes=np.zeros(rows, EPISODE),
            vehicles=np.zeros(capacity, kind),
            before=np.zeros(capacity, kind),
            after=np.zeros(capacity, kind),
            present=np.zeros((size, 2), np.int64),
            reached=np.zeros(observed, np.float32),
            observation=np.zeros(observed, np.float32),
            signals=np.zeros((size, len(SIGNALS))),
            rewards=np.zeros((size, 2)),
            classical=np.zeros((size, 2)),
            speed=np.zeros(rows),
            ending=np.zeros(rows, np.int8),
            contact=np.zeros(rows, np.int8),
            neighbours_collided=np.zeros(rows, np.int64),
            braking=np.zeros(capacity, np.bool_),
            trace=np.zeros(frames, kind),
        )
