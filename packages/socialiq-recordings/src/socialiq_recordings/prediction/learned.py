"""Policies of our learners as driver models: a clone, and the dial.

Actions are levels of acceleration, and all folds are trained in one compiled program.

The offline dial (`learners.dial.offline`) of a fold sees its training moments alone. β clones their
drivers, and π_α is the policy that is best for R(α) within what they do, its rewards predicted at
each decision (`rewards`). A driver of angle α takes level k with

    p(k | s) proportional to β(k | s) (π_α(k | s) / β(k | s))^κ

so that κ = 0 is the clone and κ = 1 the dial. κ is shared. It, the population's mean angle and its
spread have a prior that is even over grids, and all are integrated out. Their posterior is from the
training drivers, each predicted by a dial of the other half of them: of its own drivers β knows too
much for κ to be above 0. That of a driver's own angle is from its first half too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64
from scipy.special import log_softmax, logsumexp, softmax

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners import behaviour_cloning
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.learners.dial.offline import train
from socialiq.learners.settings import check_counts
from socialiq.nn.q_network import network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Ending, RewardPair
from socialiq_recordings.prediction import hierarchy
from socialiq_recordings.prediction.following import features
from socialiq_recordings.prediction.models import Fitted, Forecast, Spread, Task
from socialiq_recordings.prediction.rewards import rewards
from socialiq_recordings.prediction.situations import Situations, grouped

Chances = Callable[[Situations], Float64[np.ndarray, "moment policy level"]]
"""Function that returns each policy's log-probability of each level."""

Shares = Float64[np.ndarray, " policy"]
"""Log-probabilities of policies."""

_LEAST = 1e-12  # probability of a level


@dataclass(frozen=True)
class Training:
    """Settings of the training."""

    # accelerations that are actions, m/s², equally spaced
    levels: tuple[float, ...] = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
    updates: int = 500  # gradient steps
    hidden: tuple[int, ...] = (32,)  # widths of the hidden layers
    batch_size: int = 64  # moments of a batch
    discount: float = 0.9  # γ of a second

    def __post_init__(self) -> None:
        """Refuse what no training could take, before the slow work."""
        check_counts(self, ("updates", "batch_size"))


def nearest(grid: Float64[np.ndarray, " level"], values: Any) -> Int64[np.ndarray, " moment"]:
    """Return the index of the closest of equally spaced, ascending accelerations, m/s²."""
    index = np.rint((np.asarray(values) - grid[0]) / (grid[1] - grid[0]))
    return np.clip(index, 0, len(grid) - 1).astype(np.int64)


def demonstrations(situations: Situations, levels: Sequence[float]) -> Demonstrations:
    """Return moments as demonstrations whose actions are levels of acceleration.

    An episode is an unbroken sequence of a vehicle's moments, and ends as it leaves the view. The
    levels, in m/s², are ascending and equally spaced.
    """
    moments = situations.rows(
        np.lexsort((situations.time, situations.recording, situations.vehicle))
    )
    goes_on = moments.previous() == np.arange(len(moments)) - 1
    goes_on[0] = False
    last = np.append(~goes_on[1:], True)
    observation = features(moments)
    after = features(moments.advanced(moments.acceleration))
    after[~last] = observation[1:][goes_on[1:]]
    grid = np.array(levels)
    pair, action = rewards(moments, grid), nearest(grid, moments.acceleration)
    rows = np.arange(len(moments))
    return Demonstrations.of(
        observation=observation,
        action=action,
        next_observation=after,
        ending=np.where(last, int(Ending.TIMEOUT), int(Ending.NONE)),
        rewards=RewardPair(*(reward[rows, action] for reward in pair)),
        episode=np.cumsum(~goes_on) - 1,
        n_actions=len(levels),
    )


class Levels:
    """Densities of policies over levels, by the accelerations of the training moments.

    A policy's density of an acceleration is a mixture over the levels, its probabilities the
    weights: each level stands for the training accelerations that are nearest to it, with their
    mean as its centre and one fitted spread around it.
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
        self, chances: Chances, situations: Situations
    ) -> Float64[np.ndarray, "moment policy"]:
        """Return each policy's log-density of the observed accelerations, 1 / (m/s²)."""
        alone = [Forecast.at(np.full(len(situations), centre)) for centre in self.centre]
        observed = situations.acceleration, situations.moving
        of_level = np.stack([self.spread.log_density(level, *observed) for level in alone], axis=1)
        return np.asarray(logsumexp(chances(situations) + of_level[:, None, :], axis=2))

    def fitted(
        self, chances: Chances, log_share: Shares, by_driver: dict[int, Shares] | None = None
    ) -> Fitted:
        """Return the model of some policies, mixed.

        `log_share` is the log-probability of each policy, `by_driver` the same of known drivers.
        """
        shares_of = by_driver or {}

        def forecast(situations: Situations, _last: Any) -> Forecast:
            shares = [shares_of.get(vehicle, log_share) for vehicle in situations.vehicle.tolist()]
            columns = np.array(shares).reshape(len(situations), len(log_share), 1)
            mixed = np.asarray(logsumexp(columns + chances(situations), axis=1))
            return Forecast(mixed, np.tile(self.centre, (len(situations), 1)))

        return Fitted(forecast, self.spread, by_driver is not None)


def of_policies(policies: Sequence[Any]) -> Chances:
    """Return the log-probabilities of policies that read `features`, by their `probabilities`."""

    def chances(situations: Situations) -> Float64[np.ndarray, "moment policy level"]:
        inputs = features(situations).astype(np.float32)
        by_policy = [np.asarray(policy.probabilities(inputs)) for policy in policies]
        chance = np.maximum(np.stack(by_policy, axis=1).astype(np.float64), _LEAST)
        return np.log(chance / chance.sum(axis=2, keepdims=True))

    return chances


AT_ANGLE, BY_DRIVER = "dial", "dial, angle by driver"
CLONE = "clone"
LEARNED = (CLONE, AT_ANGLE, BY_DRIVER)  # models that our learners train
ANGLES = np.linspace(0.0, 90.0, 7)  # degrees; angles integrated over, and spreads of them
SHARES = (0.0, 0.125, 0.25, 0.5, 1.0)  # κ: how far drivers go from the clone to the dial
TEMPERATURE = 1.0  # η of the dial at all angles, s: its rewards are seconds
_RATE = 3e-3  # Adam's initial learning rate, which falls; few updates need more than the default
_PARTS = 2  # of the training drivers


def trained(
    tasks: Sequence[Task], settings: Training, names: Sequence[str]
) -> list[dict[str, Fitted]]:
    """Return the models `names` of `LEARNED` of every fold, by name."""
    models: list[dict[str, Fitted]] = [{} for _ in tasks]
    tables = [demonstrations(task.train, settings.levels) for task in tasks]
    if CLONE in names:
        shape = behaviour_cloning.CloningConfig(
            hidden=settings.hidden, batch_size=settings.batch_size, updates=settings.updates
        )
        runs = [
            behaviour_cloning.CloningHyperparameters(
                learning_rate=1e-3, seed=task.seed, dataset=fold
            )
            for fold, task in enumerate(tasks)
        ]
        clones = behaviour_cloning.BehaviourCloning.train_on(shape, runs, tables)
        for fold, task in enumerate(tasks):
            chances = of_policies([clones.policy(fold)])
            models[fold][CLONE] = Levels(task, settings).fitted(chances, np.zeros(1))
    if {AT_ANGLE, BY_DRIVER} & set(names):
        for fitted, dials in zip(models, _dials(tasks, tables, settings), strict=True):
            fitted |= {name: model for name, model in dials.items() if name in names}
    return models


def _dials(
    tasks: Sequence[Task], tables: Sequence[Demonstrations], settings: Training
) -> list[dict[str, Fitted]]:
    """Return the dial of every fold: with one angle for all, and by driver."""
    groups = [grouped(task.train.vehicle, _PARTS) for task in tasks]
    data, seeds = [*tables], [task.seed for task in tasks]
    for task, group in zip(tasks, groups, strict=True):
        for number in range(_PARTS):
            besides = group != number
            besides = besides if besides.any() else ~besides  # all, if there is no other part
            data.append(demonstrations(task.train.rows(besides), settings.levels))
            seeds.append(task.seed)
    longest = max(int(np.bincount(table.episode).max()) for table in data)
    shape = OfflineDialConfig(
        low=float(ANGLES[0]),
        high=float(ANGLES[-1]),
        high_share=None,
        view="flat",
        hidden=settings.hidden,
        batch_size=settings.batch_size,
        updates=settings.updates,
        whole_episode=longest + 1,  # a vehicle that leaves the view drives on
    )
    numbers = [
        OfflineDialHyperparameters(
            temperature=TEMPERATURE,
            end_temperature=TEMPERATURE,
            discount=settings.discount,
            learning_rate=_RATE,
            seed=seed,
        )
        for seed in seeds
    ]
    stages = train(shape, numbers, data)
    clones = stages["behaviour"].state.target_network
    families = []
    for index in range(len(data)):
        clone, dial = QPolicy.of(network_of(clones, index), 1.0, {}), stages["dial"].policy(index)
        families.append(of_family([clone, *(dial.at(angle) for angle in ANGLES.tolist())]))
    models = []
    for fold, (task, group) in enumerate(zip(tasks, groups, strict=True)):
        levels, first = Levels(task, settings), len(tasks) + _PARTS * fold
        density = np.empty((len(task.train), len(SHARES) * len(ANGLES)))
        for number, chances in enumerate(families[first : first + _PARTS]):
            rows = group == number
            density[rows] = levels.log_density(chances, task.train.rows(rows))
        models.append(_models(task, levels, families[fold], density))
    return models


def of_family(policies: Sequence[Any]) -> Chances:
    """Return log p(k | s) for each κ of `SHARES` and each angle of `ANGLES`, κ first.

    Args:
        policies: β, then π of each angle; each with a method `probabilities`.
    """
    every = of_policies(policies)
    share = np.array(SHARES)[:, None, None]

    def chances(situations: Situations) -> Float64[np.ndarray, "moment policy level"]:
        log_chances = every(situations)
        clone, turned = log_chances[:, None, :1], log_chances[:, None, 1:]
        mixed = log_softmax((1 - share) * clone + share * turned, axis=3)
        return mixed.reshape(len(situations), -1, mixed.shape[3])

    return chances


def _models(
    task: Task, levels: Levels, chances: Chances, density: Float64[np.ndarray, "moment policy"]
) -> dict[str, Fitted]:
    """Return the dial at the angle of the population, and at each driver's."""
    _, likelihood = _by_driver(density, task.train.vehicle)
    alike = softmax(likelihood.sum(axis=0))
    differ = hierarchy.driver_prior(likelihood, hierarchy.populations(ANGLES, ANGLES))
    of_own = levels.log_density(chances, task.own)
    vehicles, own_likelihood = _by_driver(of_own, task.own.vehicle)
    posterior = hierarchy.driver_posteriors(own_likelihood, differ)
    by_driver = dict(zip(vehicles.tolist(), map(_log, posterior), strict=True))
    at_angle = levels.fitted(chances, _log(alike))
    share = {"dial_share": float(alike.sum(axis=1) @ np.array(SHARES))}
    return {
        AT_ANGLE: at_angle._replace(inferred=share),
        BY_DRIVER: levels.fitted(chances, _log(differ), by_driver),
    }


def _by_driver(
    density: Float64[np.ndarray, "moment policy"], vehicle: Int64[np.ndarray, " moment"]
) -> tuple[Int64[np.ndarray, " driver"], Float64[np.ndarray, "driver shared value"]]:
    """Return the drivers in the order of their numbers, and the log-likelihood of each."""
    vehicles, driver = np.unique(vehicle, return_inverse=True)
    shaped = density.reshape(len(density), len(SHARES), len(ANGLES))
    return vehicles, hierarchy.driver_log_likelihood(shaped, driver, len(vehicles))


def _log(chance: Float64[np.ndarray, "shared value"]) -> Shares:
    return np.log(np.maximum(chance.ravel(), np.finfo(np.float64).tiny))
