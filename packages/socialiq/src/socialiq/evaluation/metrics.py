"""Metrics of thesis 5.4, from exact evaluation or rollouts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.social.angle import angle_of, score, weights
from socialiq.types import Ending, RewardPair


class Metrics(NamedTuple):
    """Means over episodes.

    Attributes:
        r_env: Mean sum of r_env of an episode.
        r_social: Mean sum of r_social.
        angle: α̂ in degrees, of these means.
        collision: Share of episodes that end in a collision.
        arrival: Share of episodes that end in an arrival.
        timeout: Share of episodes that end by the time limit.
        mean_speed: Cells (or metres) per step, over all steps.
        stopped: Share of steps at speed 0.
        length: Mean number of steps.
    """

    r_env: float
    r_social: float
    angle: float
    collision: float
    arrival: float
    timeout: float
    mean_speed: float
    stopped: float
    length: float

    @staticmethod
    def of(
        totals: RewardPair,
        endings: Float[np.ndarray, " kind"],
        mean_speed: float,
        stopped: float,
        length: float,
    ) -> Metrics:
        """Build metrics from mean totals and the share of each `Ending`."""
        return Metrics(
            r_env=float(totals.env),
            r_social=float(totals.social),
            angle=angle_of(float(totals.env), float(totals.social)),
            collision=float(endings[Ending.COLLISION]),
            arrival=float(endings[Ending.ARRIVAL]),
            timeout=float(endings[Ending.TIMEOUT]),
            mean_speed=float(mean_speed),
            stopped=float(stopped),
            length=float(length),
        )

    @property
    def totals(self) -> RewardPair:
        """Mean reward totals as a pair."""
        return RewardPair(self.r_env, self.r_social)

    def value(self, angle: float) -> float:
        """Return J(α), the mean total scored at an angle in degrees (Eq 4.3)."""
        return float(score(weights(angle), self.totals))


def mean_of(metrics: list[Metrics]) -> Metrics:
    """Average metrics over training seeds; the angle is that of the mean totals."""
    mean = Metrics(*np.mean(np.array(metrics), axis=0).tolist())
    return mean._replace(angle=angle_of(mean.r_env, mean.r_social))
