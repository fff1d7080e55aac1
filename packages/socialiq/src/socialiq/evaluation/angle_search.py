"""Search of the social angle whose policy acts most as wanted (thesis 8.5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Row

ANGLES = tuple(float(angle) for angle in range(0, 91, 5))
"""Angles of the policies, degrees."""
RESAMPLES = 1000
"""Draws of the wanted episodes for the interval."""

PoliciesAt = Callable[[Sequence[float]], Sequence[Any]]
"""Trains a policy for each angle; a policy has `probabilities` of actions."""


@dataclass(frozen=True)
class AngleSearch:
    """Outcome of a search.

    Attributes:
        angle: Angle whose policy gives the wanted actions the highest likelihood, degrees.
        low: Lower end of the 95 % interval of the angle over draws of the wanted episodes.
        high: Upper end.
        table: `angle` and `log_likelihood` of an action, the mean of the wanted ones, by angle.
    """

    angle: float
    low: float
    high: float
    table: list[Row]


def search(policies_at: PoliciesAt, episodes: Demonstrations) -> AngleSearch:
    """Find the angle from 0 to 90 degrees at which a learner's policy acts most as episodes.

    A policy's measure is the likelihood of the wanted actions under softmax(Q/τ).

    Args:
        policies_at: Trains policies.
        episodes: Episodes of wanted behaviour, with the observations of the training; their rewards
            aren't read.

    Returns:
        The angle, with its interval.

    Raises:
        UserError: If there are fewer than two episodes, since an interval needs them.
    """
    n_episodes = len(episodes.episode_starts)
    if n_episodes < 2:
        raise UserError("an angle is searched with two or more episodes of wanted behaviour")
    of_episodes = _likelihoods(policies_at(ANGLES), episodes)
    draws = np.random.default_rng(0).multinomial(
        n_episodes, np.full(n_episodes, 1.0 / n_episodes), RESAMPLES
    )
    chosen = np.array(ANGLES)[np.argmax(of_episodes @ draws.T, axis=0)]
    low, high = np.quantile(chosen, (0.025, 0.975), method="nearest")
    totals = of_episodes.sum(axis=1)
    table = [
        {"angle": angle, "log_likelihood": float(total / len(episodes.action))}
        for angle, total in zip(ANGLES, totals, strict=True)
    ]
    return AngleSearch(ANGLES[int(np.argmax(totals))], float(low), float(high), table)


def _likelihoods(
    policies: Sequence[Any], episodes: Demonstrations
) -> Float[np.ndarray, "policy episode"]:
    """Return the log-likelihood of each wanted episode's actions under each policy."""
    rows = np.arange(len(episodes.action))
    likelihoods = []
    for policy in policies:
        chances = policy.probabilities(episodes.observation)[rows, episodes.action]
        of_actions = np.log(np.maximum(chances, 1e-12))
        likelihoods.append(np.add.reduceat(of_actions, episodes.episode_starts))
    return np.stack(likelihoods)
