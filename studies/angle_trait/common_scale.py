"""Common scale of the angles of several dials: what they bring others in the same traffic.

Two dials behave differently at the same angle. The sum of r_social over an episode is the same
quantity for all of them. An angle of a dial is therefore given as the angle at which a family of
dials brings others as much in the mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import isotonic_regression

from socialiq.evaluation.episodes import episodes_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options

_TIE = 1e-9  # rise from angle to angle where an isotonic curve is flat


class Realised(NamedTuple):
    """Rewards that a dial realises at its angles, means over episodes.

    Attributes:
        angle: Angles of the dial, degrees, ascending.
        env: Sum of r_env over an episode.
        social: Sum of r_social over an episode.
    """

    angle: Float[np.ndarray, " angle"]
    env: Float[np.ndarray, " angle"]
    social: Float[np.ndarray, " angle"]

    @staticmethod
    def of(dial: DialPolicy, episodes: int, first: int, step: float = 5.0) -> Realised:
        """Drive a dial greedily at angles of equal distance, the same episodes at each.

        Args:
            dial: The dial.
            episodes: Number of episodes at each angle.
            first: Seed of the first episode.
            step: Of the angles, degrees.
        """
        count = max(2, round((dial.high - dial.low) / step) + 1)
        angle = np.linspace(dial.low, dial.high, count)
        batch, seeds = Batch(Options(), episodes), np.arange(first, first + episodes)
        driven = [episodes_of(batch, dial.at(one), seeds).metrics() for one in angle.tolist()]
        env, social = np.array([one.totals for one in driven]).T
        return Realised(angle, env, social)

    @property
    def rising(self) -> Float[np.ndarray, " angle"]:
        """The nearest curve of r_social that nowhere falls (isotonic regression)."""
        return isotonic_regression(self.social).x + _TIE * np.arange(len(self.social))

    def social_at(self, angle: Float[np.ndarray, " point"]) -> Float[np.ndarray, " point"]:
        """Return r_social at angles of the dial, between driven ones by linear interpolation."""
        return np.interp(angle, self.angle, self.social)

    def angle_of(self, social: Float[np.ndarray, " point"]) -> Float[np.ndarray, " point"]:
        """Return the angles at which the dial brings so much; its ends for what it never brings."""
        return np.interp(social, self.rising, self.angle)


def mean_of(family: Sequence[Realised]) -> Realised:
    """Return the mean of several dials at the same angles, each one's r_social nowhere falling."""
    env = np.mean([one.env for one in family], axis=0)
    social = np.mean([one.rising for one in family], axis=0)
    return Realised(family[0].angle, env, social)
