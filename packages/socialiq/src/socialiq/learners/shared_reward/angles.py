"""The demonstrators' angles, inferred together with what they share: expectation-maximisation.

The absolute angle is a gauge: moving a part of R(a) into f and out of every a_i leaves all rewards
as they are. Two conventions fix it. Every direction (cos a, sin a) has length 1, so with three
demonstrators of different angles no common shift is left; and f is drawn to 0, so of corrections
that explain alike the smallest counts, which leaves to the angles what they can explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.learners.shared_reward.exact import Fit, Group, Settings, fit
from socialiq.mdp.horizon import soft_horizon_optimum
from socialiq.mdp.tabular import TabularMDP
from socialiq.social.angle import score, weights

_NEGLIGIBLE = 1e-6  # of a posterior; below it an angle's group is left out


class Inferred(NamedTuple):
    """Fit of the demonstrators.

    Attributes:
        fit: Of the shared correction, at the last posterior.
        posterior: Probability of each angle for each demonstrator.
        path: Posterior mean angle of each demonstrator before each round, in degrees.
    """

    fit: Fit
    posterior: Float[np.ndarray, "demonstrator angle"]
    path: Float[np.ndarray, "round demonstrator"]


def infer(
    mdp: TabularMDP,
    counts: Sequence[Float[np.ndarray, "time state action"]],
    episodes: Sequence[int],
    angles: Sequence[float],
    settings: Settings,
    rounds: int = 8,
) -> Inferred:
    """Alternate between posteriors of the angles and the correction that fits them best.

    Args:
        mdp: The dynamics and the reward pair.
        counts: For each demonstrator how often it took an action at a time in a state, summed over
            its episodes.
        episodes: Number of episodes of each demonstrator.
        angles: Grid of social angles in degrees, all equally likely beforehand.
        settings: Of the fit.
        rounds: How often to alternate.

    Raises:
        UserError: If there is no demonstrator or no angle, or they don't fit the MDP.
    """
    if not counts or not angles or len(counts) != len(episodes) or rounds < 1:
        raise UserError("inference needs demonstrators with their episodes, angles, and a round")
    rewards = [score(weights(angle), mdp.rewards) for angle in angles]
    visits = [one.sum(axis=0) / number for one, number in zip(counts, episodes, strict=True)]
    found, path = None, []
    posterior = np.empty((0, 0))
    for _ in range(rounds):
        correction = found.correction if found else np.zeros_like(rewards[0])
        posterior = _posterior(mdp, counts, rewards, correction, settings)
        path.append(posterior @ np.asarray(angles))
        found = fit(mdp, _groups(visits, posterior, rewards), settings, correction)
    assert found is not None
    return Inferred(found, posterior, np.array(path))


def _posterior(
    mdp: TabularMDP,
    counts: Sequence[np.ndarray],
    rewards: Sequence[np.ndarray],
    correction: np.ndarray,
    settings: Settings,
) -> Float[np.ndarray, "demonstrator angle"]:
    """p(a | demonstrator), from the likelihood of its actions under the soft policy of f + R(a)."""
    logs = []
    for reward in rewards:
        best = soft_horizon_optimum(
            mdp, reward + correction, settings.horizon, settings.temperature
        )
        likelihood = np.log(np.maximum(best.probabilities, np.finfo(float).tiny))
        logs.append([float((one * likelihood).sum()) for one in counts])
    columns = np.array(logs).T
    odds = np.exp(columns - columns.max(axis=1, keepdims=True))
    return odds / odds.sum(axis=1, keepdims=True)


def _groups(
    visits: Sequence[np.ndarray], posterior: np.ndarray, rewards: Sequence[np.ndarray]
) -> list[Group]:
    """One group for each angle that some demonstrator may have."""
    groups = []
    for column, reward in zip(posterior.T, rewards, strict=True):
        weight = float(column.sum())
        if weight > _NEGLIGIBLE:
            mixed = np.tensordot(column, np.stack(visits), axes=1) / weight
            groups.append(Group(weight / len(visits), mixed, reward))
    return groups
