"""Levels of acceleration as actions: moments as demonstrations, and densities of policies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.special import logsumexp

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.config import check_counts
from socialiq.types import Ending, RewardPair
from socialiq_recordings.prediction.choices import nearest
from socialiq_recordings.prediction.density import Forecast, Spread
from socialiq_recordings.prediction.features import features
from socialiq_recordings.prediction.models import Fitted, Task
from socialiq_recordings.prediction.rewards import rewards
from socialiq_recordings.prediction.situation import Situations

Chances = Callable[[Situations], Float64[np.ndarray, "moment policy level"]]
"""Function that returns each policy's log-probability of each level."""

_LEAST = 1e-12  # probability of a level


@dataclass(frozen=True)
class Training:
    """Settings of the training.

    Attributes:
        levels: Accelerations that are actions, m/s², equally spaced.
        updates: Gradient steps.
        hidden: Widths of the hidden layers.
        batch_size: Moments of a batch.
        discount: γ of a second.
    """

    levels: tuple[float, ...] = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
    updates: int = 500
    hidden: tuple[int, ...] = (32,)
    batch_size: int = 64
    discount: float = 0.9

    def __post_init__(self) -> None:
        """Refuse what no training could take, before the slow work."""
        check_counts(self, ("updates", "batch_size"))


def demonstrations(seen: Situations, levels: Sequence[float]) -> Demonstrations:
    """Return moments as demonstrations whose actions are levels of acceleration.

    An episode is an unbroken sequence of a vehicle's moments, and ends as it leaves the view.

    Args:
        seen: Moments.
        levels: m/s², ascending and equally spaced.
    """
    seen = seen.rows(np.lexsort((seen.time, seen.recording, seen.vehicle)))
    goes_on = seen.previous() == np.arange(len(seen)) - 1
    goes_on[0] = False
    last = np.append(~goes_on[1:], True)
    observation = features(seen)
    after = features(seen.advanced(seen.acceleration))
    after[~last] = observation[1:][goes_on[1:]]
    grid = np.array(levels)
    pair, action = rewards(seen, grid), nearest(grid, seen.acceleration)
    rows = np.arange(len(seen))
    return Demonstrations.of(
        observation=observation,
        action=action,
        next_observation=after,
        ending=np.where(last, int(Ending.TIMEOUT), int(Ending.NONE)),
        rewards=RewardPair(*(one[rows, action] for one in pair)),
        episode=np.cumsum(~goes_on) - 1,
        n_actions=len(levels),
    )


class Levels:
    """Densities of policies over levels, by the accelerations of the training moments.

    A policy's density of an acceleration is a mixture over the levels, its probabilities the
    weights: each level stands for the training accelerations that are nearest to it, with their
    mean as its centre and one fitted spread around it.

    Args:
        task: The fold.
        settings: Settings.
    """

    def __init__(self, task: Task, settings: Training) -> None:
        grid = np.array(settings.levels)
        observed = task.train.acceleration
        action = nearest(grid, observed)
        count = np.bincount(action, minlength=len(grid))
        sums = np.bincount(action, observed, minlength=len(grid))
        self.centre = np.where(count > 0, sums / np.maximum(count, 1), grid)
        self.spread = Spread.fit(observed - self.centre[action], observed, task.train.moving)

    def log_density(
        self, chances: Chances, seen: Situations
    ) -> Float64[np.ndarray, "moment policy"]:
        """Return each policy's log-density of the observed accelerations, 1 / (m/s²)."""
        alone = [Forecast.at(np.full(len(seen), one)) for one in self.centre]
        of_level = np.stack(
            [self.spread.log_density(one, seen.acceleration, seen.moving) for one in alone], axis=1
        )
        return np.asarray(logsumexp(chances(seen) + of_level[:, None, :], axis=2))

    def fitted(
        self,
        chances: Chances,
        log_share: Float64[np.ndarray, " policy"],
        by_driver: dict[int, Float64[np.ndarray, " policy"]] | None = None,
    ) -> Fitted:
        """Return the model of some policies, mixed.

        Args:
            chances: Of the policies.
            log_share: Log-probability of each policy, for drivers that aren't known.
            by_driver: The same of known drivers.
        """
        known = by_driver or {}

        def forecast(seen: Situations, last: Any) -> Forecast:  # noqa: ARG001
            shares = np.array([known.get(one, log_share) for one in seen.vehicle.tolist()])
            shares = shares.reshape(len(seen), len(log_share), 1)
            mixed = np.asarray(logsumexp(shares + chances(seen), axis=1))
            return Forecast(mixed, np.tile(self.centre, (len(seen), 1)))

        return Fitted(forecast, self.spread, by_driver is not None)


def of_policies(policies: Sequence[Any]) -> Chances:
    """Return the log-probabilities of policies that read `features`.

    Args:
        policies: Each with a method `probabilities`.
    """

    def chances(seen: Situations) -> Float64[np.ndarray, "moment policy level"]:
        given = features(seen).astype(np.float32)
        each = np.stack([np.asarray(one.probabilities(given)) for one in policies], axis=1)
        each = np.maximum(each.astype(np.float64), _LEAST)
        return np.log(each / each.sum(axis=2, keepdims=True))

    return chances
