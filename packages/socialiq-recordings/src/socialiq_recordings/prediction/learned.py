"""Policies of our learners as driver models: a clone, and IQ-Learn at social angles.

Actions are levels of acceleration. All folds are trained in one compiled program. IQ-Learn is
offline with its rewards predicted at each decision (`rewards`), and its soft policy predicts: at
the angle that is the most likely for the training moments, or at the angles that a driver's first
half makes likely, integrated out. The dial is in `dial`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64, Int64
from scipy.special import logsumexp

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners import behaviour_cloning
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.iq_learn.train import train
from socialiq_recordings.prediction import dial
from socialiq_recordings.prediction.levels import Levels, Training, demonstrations, of_policies
from socialiq_recordings.prediction.models import Fitted, Task

CLONE, AT_ANGLE, BY_DRIVER = "clone", "IQ-Learn", "IQ-Learn, angle by driver"
LEARNED = (CLONE, AT_ANGLE, BY_DRIVER, dial.AT_ANGLE, dial.BY_DRIVER)
"""Models that our learners train."""


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
            chances = of_policies([clones.policy(place)])
            found[place][CLONE] = Levels(task, settings).fitted(chances, np.zeros(1))
    if {AT_ANGLE, BY_DRIVER} & set(names):
        _iq_learned(tasks, tables, settings, names, found)
    if {dial.AT_ANGLE, dial.BY_DRIVER} & set(names):
        for one, more in zip(found, dial.trained(tasks, tables, settings), strict=True):
            one |= {name: model for name, model in more.items() if name in names}
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
        of_levels, chances = Levels(task, settings), of_policies(each)
        if AT_ANGLE in names:
            best = int(np.argmax(of_levels.log_density(chances, task.train).mean(axis=0)))
            found[place][AT_ANGLE] = of_levels.fitted(of_policies([each[best]]), np.zeros(1))
        if BY_DRIVER in names:
            alike = np.full(count, -np.log(count))
            shares = _shares(of_levels.log_density(chances, task.own), task.own.vehicle)
            found[place][BY_DRIVER] = of_levels.fitted(chances, alike, shares)


def _shares(
    log_density: Float64[np.ndarray, "moment policy"], vehicle: Int64[np.ndarray, " moment"]
) -> dict[int, Float64[np.ndarray, " policy"]]:
    """Return the log-probability of each policy by driver, from its own first half."""
    found = {}
    for one in np.unique(vehicle).tolist():
        total = log_density[vehicle == one].sum(axis=0)
        found[one] = total - logsumexp(total)
    return found
