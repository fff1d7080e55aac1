"""Brake for people on foot, whatever a policy wants."""

from __future__ import annotations

import math

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.simulate import Watched
from socialiq.types import Policy
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.core.compile import run_in_parts
from socialiq.worlds.highway.options import settings_of
from socialiq.worlds.highway.people import PeopleOptions
from socialiq.worlds.intersection import policies


class Shield(Watched):
    """A policy that goes slower where the time to collision with a person is below a threshold.

    The person walks in the ego's lane or towards it. The time is that of the ego's way at its
    speed, or at the lowest speed above 0 if it drives slower: it must not start before a person.
    The state of the batch that it drives is read, so a policy that observes the vehicles alone can
    be shielded.

    Raises:
        UserError: If no person walks in the world, or the threshold is not positive.
    """

    def __init__(self, policy: Policy, batch: RoadBatch, seconds: float) -> None:
        if not isinstance(batch.options, PeopleOptions):
            raise UserError(
                "a shield is for people on foot, and no one walks here: choose crosswalks"
            )
        if not 0.0 < seconds < math.inf:
            raise UserError(f"a shield needs a positive number of seconds, got {seconds:g}")
        settings = settings_of(batch.options)

        def is_near(_rows: np.ndarray) -> np.ndarray:
            from socialiq.worlds.highway.core.people import near

            buffers = batch.buffers
            braking = np.zeros(batch.size, bool)
            records = buffers.episodes, buffers.vehicles, buffers.people
            run_in_parts(
                near, 1, batch.size, *records, batch.road, settings, float(seconds), braking
            )
            return braking

        super().__init__(policy, is_near, policies.policy("wait"))


def shielded(policy: Policy, batch: RoadBatch, seconds: float) -> Policy:
    """Return a policy with a shield in its batch.

    Args:
        policy: The policy.
        batch: Episodes that it drives.
        seconds: Time to collision with a person below which the ego goes slower, s; for 0 the
            policy is returned as it is.
    """
    return Shield(policy, batch, seconds) if seconds else policy
