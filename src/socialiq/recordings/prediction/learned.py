"""Policies of our learners as driver models: a clone, and IQ-Learn at social angles.

Actions are levels of acceleration. All folds are trained in one compiled program. IQ-Learn is
offline with its rewards predicted at each decision (`rewards`), and its soft policy predicts: at
the angle that is the most likely for the training moments, or at the angles that a driver's first
half makes likely, integrated out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.special import logsumexp

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners import behaviour_cloning
from socialiq.learners.config import check_counts
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.iq_learn.train import train
from socialiq.recordings.prediction.choices import nearest
from socialiq.recordings.prediction.density import Forecast, Spread
from socialiq.recordings.prediction.features import features
from socialiq.recordings.prediction.models import Fitted, Task
from socialiq.recordings.prediction.rewards import rewards
from socialiq.recordings.prediction.situation import Situations
from socialiq.social.angle import check_angle
from socialiq.types import Ending, RewardPair

CLONE, AT_ANGLE, BY_DRIVER = "clone", "IQ-Learn", "IQ-Learn, angle by driver"
LEARNED = (CLONE, AT_ANGLE, BY_DRIVER)
"""Models that our learners train."""


@dataclass(frozen=True)
class Training:
    """Settings of the training.

    Attributes:
        levels: Accelerations that are actions, m/s², equally spaced.
        angles: Angles of IQ-Learn, degrees.
        updates: Gradient steps.
        hidden: Widths of the hidden layers.
        batch_size: Moments of a batch.
        discount: γ of a second.
    """

    levels: tuple[float, ...] = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
    angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    updates: int = 500
    hidden: tuple[int, ...] = (32,)
    batch_size: int = 64
    discount: float = 0.9

    def __post_init__(self) -> None:
        """Refuse what no training could take, before the slow work."""
        check_counts(self, ("updates", "batch_size"))
        if not self.angles:
            raise UserError("IQ-Learn needs at least one angle in degrees")
        for angle in self.angles:
            check_angle(angle)


def trained(
    tasks: Sequence[Task], settings: Training, names: Sequence[str]
) -> list[dict[str, Fitted]]:
    """Return the learned models of every fold, by name.

    Args:
        tasks: One for each fold.
        settings: Settings.
        names: Those of `LEARNED` that are wanted.
    """
    found: list[dict[str, Fitted]] = [{} for _ in tasks]
    tables = [demonstrations(one.train, settings.levels) for one in tasks]
    seeds = [one.seed for one in tasks]
    if CLONE in names:
        shape = behaviour_cloning.StaticConfig(
            hidden=settings.hidden, batch_size=settings.batch_size, updates=settings.updates
        )
        runs = [
            behaviour_cloning.Hyperparameters(learning_rate=1e-3, seed=seed, dataset=place)
            for place, seed in enumerate(seeds)
        ]
        clones = behaviour_cloning.BehaviourCloning.train_on(shape, runs, tables)
        for place, task in enumerate(tasks):
            found[place][CLONE] = _Levels(task, settings).fitted([clones.policy(place)])
    if {AT_ANGLE, BY_DRIVER} & set(names):
        _iq_learned(tasks, tables, settings, names, found)
    return found


def _iq_learned(
    tasks: Sequence[Task],
    tables: Sequence[Demonstrations],
    settings: Training,
    names: Sequence[str],
    found: list[dict[str, Fitted]],
) -> None:
    shape = replace(
        presets.FEW_OFFLINE,
        prior="reward",
        target_kind="instantaneous",
        endings=Endings(timeout="bootstrap"),
        hidden=settings.hidden,
        batch_size=settings.batch_size,
        updates=settings.updates,
    )
    numbers = replace(presets.FEW_OFFLINE_NUMBERS, discount=settings.discount)
    runs = [
        replace(numbers, angle=angle, dataset=place, seed=task.seed)
        for place, task in enumerate(tasks)
        for angle in settings.angles
    ]
    policies = train(shape, runs, list(tables))
    count = len(settings.angles)
    for place, task in enumerate(tasks):
        each = [policies.policy(place * count + one) for one in range(count)]
        of_levels = _Levels(task, settings)
        if AT_ANGLE in names:
            best = int(np.argmax([of_levels.likelihood(one) for one in each]))
            found[place][AT_ANGLE] = of_levels.fitted([each[best]])
        if BY_DRIVER in names:
            found[place][BY_DRIVER] = of_levels.fitted(each, of_levels.shares(each))


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


class _Levels:
    """Densities of policies over levels, by the accelerations of the training moments.

    Args:
        task: The fold.
        settings: Settings.
    """

    def __init__(self, task: Task, settings: Training) -> None:
        grid = np.array(settings.levels)
        self.task, observed = task, task.train.acceleration
        action = nearest(grid, observed)
        count = np.bincount(action, minlength=len(grid))
        sums = np.bincount(action, observed, minlength=len(grid))
        self.centre = np.where(count > 0, sums / np.maximum(count, 1), grid)
        self.spread = Spread.fit(observed - self.centre[action], observed, task.train.moving)

    def likelihood(self, policy: Any) -> float:
        """Return the mean log-density of the training moments."""
        return float(self._densities(policy, self.task.train).mean())

    def shares(self, policies: Sequence[Any]) -> dict[int, Float64[np.ndarray, " policy"]]:
        """Return the log-probability of each policy by driver, from its own first half."""
        own, found = self.task.own, {}
        each = np.stack([self._densities(one, own) for one in policies], axis=1)
        for vehicle in np.unique(own.vehicle).tolist():
            total = each[own.vehicle == vehicle].sum(axis=0)
            found[vehicle] = total - logsumexp(total)
        return found

    def fitted(
        self,
        policies: Sequence[Any],
        shares: dict[int, Float64[np.ndarray, " policy"]] | None = None,
    ) -> Fitted:
        """Return the model of one policy, or of several by their log-probability by driver."""
        alike = np.full(len(policies), -np.log(len(policies)))

        def forecast(seen: Situations, last: Any) -> Forecast:  # noqa: ARG001
            log_share = np.array([(shares or {}).get(one, alike) for one in seen.vehicle.tolist()])
            each = np.stack([self._chances(one, seen) for one in policies], axis=1)
            mixed = np.asarray(logsumexp(log_share.reshape(len(seen), -1, 1) + each, axis=1))
            return Forecast(mixed, np.tile(self.centre, (len(seen), 1)))

        return Fitted(forecast, self.spread, shares is not None)

    def _densities(self, policy: Any, seen: Situations) -> Float64[np.ndarray, " moment"]:
        made = Forecast(self._chances(policy, seen), np.tile(self.centre, (len(seen), 1)))
        return self.spread.log_density(made, seen.acceleration, seen.moving)

    def _chances(self, policy: Any, seen: Situations) -> Float64[np.ndarray, "moment level"]:
        chance = np.asarray(policy.probabilities(features(seen).astype(np.float32)), np.float64)
        chance = np.maximum(chance, 1e-12)
        return np.log(chance / chance.sum(axis=1, keepdims=True))
