"""Policies of our learners as driver models: a clone, and the dial (`dial`).

Actions are levels of acceleration. All folds are trained in one compiled program.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from socialiq.learners import behaviour_cloning
from socialiq_recordings.prediction import dial
from socialiq_recordings.prediction.levels import Levels, Training, demonstrations, of_policies
from socialiq_recordings.prediction.models import Fitted, Task

CLONE = "clone"
LEARNED = (CLONE, dial.AT_ANGLE, dial.BY_DRIVER)
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
    if {dial.AT_ANGLE, dial.BY_DRIVER} & set(names):
        for one, more in zip(found, dial.trained(tasks, tables, settings), strict=True):
            one |= {name: model for name, model in more.items() if name in names}
    return found
