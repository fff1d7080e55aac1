"""The dial as a driver model: one network for all social angles, with a driver's angle or without.

The offline dial (`learners.offline`) of a fold sees its training moments alone. β clones their
drivers, and π_α is the policy that is best for R(α) within what they do, its rewards predicted at
each decision (`rewards`). A driver of angle α takes level k with

    p(k | s) proportional to β(k | s) (π_α(k | s) / β(k | s))^κ

so that κ = 0 is the clone and κ = 1 the dial. κ is shared. It, the population's mean angle and its
spread have a prior that is even over grids, and all are integrated out. Their posterior is from the
training drivers, each predicted by a dial of the other half of them: of its own drivers β knows too
much for κ to be above 0. That of a driver's own angle is from its first half too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.special import log_softmax

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.offline.config import Hyperparameters, StaticConfig
from socialiq.learners.offline.train import train_together
from socialiq.nn.q_network import network_of
from socialiq.nn.q_policy import QPolicy
from socialiq_recordings.prediction.folds import grouped
from socialiq_recordings.prediction.levels import (
    Chances,
    Levels,
    Training,
    demonstrations,
    of_policies,
)
from socialiq_recordings.prediction.models import Fitted, Task
from socialiq_recordings.prediction.situation import Situations
from socialiq_recordings.trait.hierarchy import (
    driver_log_likelihood,
    driver_posteriors,
    log_marginal,
    population_posterior,
)
from socialiq_recordings.trait.policy_family import family_trait

AT_ANGLE, BY_DRIVER = "dial", "dial, angle by driver"

ANGLES = np.linspace(0.0, 90.0, 7)
"""Degrees; angles integrated over."""

SHARES = (0.0, 0.125, 0.25, 0.5, 1.0)
"""κ: how far drivers go from the clone to the dial."""

TEMPERATURE = 1.0
"""η of the dial at all angles, s: its rewards are seconds."""

_RATE = 3e-3  # Adam's initial learning rate, which falls; few updates need more than the default
_PARTS = 2  # of the training drivers


def trained(
    tasks: Sequence[Task], tables: Sequence[Demonstrations], settings: Training
) -> list[dict[str, Fitted]]:
    """Return the dial of every fold as a model of drivers: with one angle for all, and by driver.

    Args:
        tasks: One for each fold.
        tables: Training moments of each as demonstrations.
        settings: Settings.
    """
    parts = [grouped(task.train.vehicle, _PARTS) for task in tasks]
    others = [
        demonstrations(task.train.rows(_besides(part, number)), settings.levels)
        for task, part in zip(tasks, parts, strict=True)
        for number in range(_PARTS)
    ]
    seeds = [task.seed for task in tasks]
    every = _dials(
        [*tables, *others], seeds + [one for one in seeds for _ in range(_PARTS)], settings
    )
    found = []
    for place, (task, part) in enumerate(zip(tasks, parts, strict=True)):
        levels, first = Levels(task, settings), len(tasks) + _PARTS * place
        density = np.empty((len(task.train), len(SHARES) * len(ANGLES)))
        for number, chances in enumerate(every[first : first + _PARTS]):
            rows = part == number
            density[rows] = levels.log_density(chances, task.train.rows(rows))
        found.append(_models(task, levels, every[place], density))
    return found


def _besides(part: Int64[np.ndarray, " moment"], number: int) -> Bool[np.ndarray, " moment"]:
    """Whether moments are of other parts; all of them, if there is no other."""
    others = part != number
    return others if others.any() else ~others


def _dials(
    tables: Sequence[Demonstrations], seeds: Sequence[int], settings: Training
) -> list[Chances]:
    """Return the family of a dial of each table, all trained in one program."""
    longest = max(int(np.bincount(one.episode).max()) for one in tables)
    shape = StaticConfig(
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
        Hyperparameters(TEMPERATURE, TEMPERATURE, settings.discount, _RATE, seed=seed)
        for seed in seeds
    ]
    stages = train_together(shape, numbers, tables)
    clones = stages["behaviour"].state.target_network
    found = []
    for place in range(len(tables)):
        clone, dial = QPolicy.of(network_of(clones, place), 1.0, {}), stages["dial"].policy(place)
        found.append(of_family([clone, *(dial.at(one) for one in ANGLES.tolist())]))
    return found


def of_family(policies: Sequence[Any]) -> Chances:
    """Return log p(k | s) for each κ of `SHARES` and each angle of `ANGLES`, κ first.

    Args:
        policies: β, then π of each angle; each with a method `probabilities`.
    """
    every = of_policies(policies)
    share = np.array(SHARES)[:, None, None]

    def chances(seen: Situations) -> Float64[np.ndarray, "moment policy level"]:
        found = every(seen)
        clone, turned = found[:, None, :1], found[:, None, 1:]
        mixed = log_softmax((1 - share) * clone + share * turned, axis=3)
        return mixed.reshape(len(seen), -1, mixed.shape[3])

    return chances


def _models(
    task: Task, levels: Levels, chances: Chances, density: Float64[np.ndarray, "moment policy"]
) -> dict[str, Fitted]:
    """Return the dial at the angle of the population, and at each driver's.

    Args:
        task: The fold.
        levels: Its levels.
        chances: Of the family.
        density: Log-densities of the training moments, by families of other drivers.
    """
    trait = family_trait(ANGLES, strengths=SHARES)
    shown = _by_driver(density, task.train.vehicle)
    alike, differ = (
        population_posterior(log_marginal(shown, one), one) for one in (trait.alike(), trait)
    )
    own = np.unique(task.own.vehicle)
    each = _by_driver(levels.log_density(chances, task.own), task.own.vehicle)
    posterior = driver_posteriors(each, differ)
    by_driver = {vehicle: _log(one) for vehicle, one in zip(own.tolist(), posterior, strict=True)}
    at_angle = levels.fitted(chances, _log(alike.driver_prior))
    share = {"dial_share": float(alike.driver_prior.sum(axis=1) @ np.array(SHARES))}
    return {
        AT_ANGLE: at_angle._replace(inferred=share),
        BY_DRIVER: levels.fitted(chances, _log(differ.driver_prior), by_driver),
    }


def _by_driver(
    density: Float64[np.ndarray, "moment policy"], vehicle: Int64[np.ndarray, " moment"]
) -> Float64[np.ndarray, "driver shared value"]:
    """Return the log-likelihood of each driver, in the order of their numbers."""
    vehicles, driver = np.unique(vehicle, return_inverse=True)
    shape = (len(density), len(SHARES), len(ANGLES))
    return driver_log_likelihood(density.reshape(shape), driver, len(vehicles))


def _log(chance: Float64[np.ndarray, "shared value"]) -> Float64[np.ndarray, " policy"]:
    return np.log(np.maximum(chance.ravel(), np.finfo(np.float64).tiny))
