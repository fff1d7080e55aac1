"""Arrays shared by Python, the core and the reference: one row for each episode."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.settings import SIGNALS
from socialiq.worlds.intersection.state import EPISODE, FEATURES, VEHICLE

RESET, DECIDE, DECIDE_AND_RESET, ANNOTATE, SKIP = range(5)
"""Commands for an episode. ANNOTATE computes a decision's results from given snapshots."""


class Buffers(NamedTuple):
    """Arrays that an engine reads and writes, each with one row for an episode.

    Attributes:
        episodes: EPISODE records, shape (batch,).
        vehicles: Current VEHICLE records, (batch, capacity).
        before: Vehicles at the last decision, (batch, capacity).
        after: Vehicles after the sub-steps of that decision, (batch, capacity).
        present: Number of vehicles in `before` and `after`, and the ego's slot, (batch, 2).
        reached: Observation of the state that the decision led to, float32.
        observation: Observation of the current state, which differs after a reset.
        signals: In the order of `SIGNALS`, unweighted.
        rewards: r_env and r_social, (batch, 2).
        classical: The ego's own reward and its neighbours' mean (thesis A.1), (batch, 2).
        speed: The ego's, m/s.
        ending: Values of `Ending`, int8.
        contact: Values of `Contact`, int8: which vehicle struck, if the ego collided.
        neighbours_collided: Number of other vehicles that collided with each other.
        braking: Whether a vehicle's braking was charged to the ego, (batch, capacity).
        trace: Vehicles after each sub-step, (batch, frames, capacity); empty if not traced.
    """

    episodes: np.ndarray
    vehicles: np.ndarray
    before: np.ndarray
    after: np.ndarray
    present: np.ndarray
    reached: np.ndarray
    observation: np.ndarray
    signals: np.ndarray
    rewards: np.ndarray
    classical: np.ndarray
    speed: np.ndarray
    ending: np.ndarray
    contact: np.ndarray
    neighbours_collided: np.ndarray
    braking: np.ndarray
    trace: np.ndarray

    @staticmethod
    def of(options: Options, size: int, traced: bool = False) -> Buffers:
        """Return empty buffers for `size` episodes, with space for every sub-step if traced."""
        rows, capacity = (size,), (size, options.capacity)
        seen = (size, options.observed_vehicles, len(FEATURES))
        frames = (size if traced else 0, options.frames, options.capacity)
        return Buffers(
            episodes=np.zeros(rows, EPISODE),
            vehicles=np.zeros(capacity, VEHICLE),
            before=np.zeros(capacity, VEHICLE),
            after=np.zeros(capacity, VEHICLE),
            present=np.zeros((size, 2), np.int64),
            reached=np.zeros(seen, np.float32),
            observation=np.zeros(seen, np.float32),
            signals=np.zeros((size, len(SIGNALS))),
            rewards=np.zeros((size, 2)),
            classical=np.zeros((size, 2)),
            speed=np.zeros(rows),
            ending=np.zeros(rows, np.int8),
            contact=np.zeros(rows, np.int8),
            neighbours_collided=np.zeros(rows, np.int64),
            braking=np.zeros(capacity, np.bool_),
            trace=np.zeros(frames, VEHICLE),
        )
