"""Brake for people on foot, whatever a policy wants."""

from __future__ import annotations

import math

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.simulate import Watched
from socialiq.types import Policy
from socialiq.worlds.highway.core.compile import run_in_parts
from socialiq.worlds.highway.world import RoadBatch
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import settings_of
from socialiq.worlds.intersection.world import Batch


class Shield(Watched):
    """A policy that goes slower where the time to collision with a person is below a threshold.

    The person walks in the ego's lane or towards it. The time is that of the ego's way at its
    speed, or at the lowest speed above 0 if it drives slower: it must not start before a person.
    The state of the batch that it drives is read, so a policy that observes the vehicles alone
    can be shielded.

    Raises:
        UserError: If no person walks there, or the threshold is not positive.
    """

    def __init__(self, policy: Policy, batch: RoadBatch, seconds: float) -> None:
        if not isinstance(batch, Batch) or not batch.walks:
            raise UserError("a shield is for people on foot: choose a world with crosswalks")
        if not 0.0 < seconds < math.inf:
            raise UserError(f"a shield needs a positive number of seconds, got {seconds:g}")
        settings = settings_of(batch.options)

        def is_near(_rows: np.ndarray) -> np.ndarray:
            from socialiq.worlds.intersection.core.people import near

            buffers, braking = batch.buffers, np.zeros(batch.size, bool)
            arguments = buffers.episodes, buffers.vehicles, settings, float(seconds), braking
            run_in_parts(near, 1, batch.size, *arguments)
            return braking

        super().__init__(policy, is_near, policies.policy("wait"))


def shielded(policy: Policy, batch: RoadBatch, seconds: float) -> Policy:
    """Return a policy with a shield of some seconds in its batch; itself for 0."""
    return Shield(policy, batch, seconds) if seconds else policy
