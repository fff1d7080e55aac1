"""Jobs of the study: dials of one recipe and several training seeds, which are a family."""

from __future__ import annotations

import dataclasses

from socialiq.experiments.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    RECORDED_EPISODES,
    SIZE,
    atlas_demonstrations,
)
from socialiq.experiments.intersection.training import MixtureDialRun, train_dial
from socialiq.experiments.jobs import Job
from socialiq.learners.dial.config import INTERSECTION
from socialiq.studies.angle_trait.config import Config


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs; none without training seeds."""
    if not config.dials:
        return []
    structure = dataclasses.replace(INTERSECTION.structure, updates=config.updates)
    jobs = [atlas_demonstrations(RECORDED_EPISODES)]
    for seed in config.dials:
        numbers = dataclasses.replace(INTERSECTION.numbers, seed=seed)
        run = MixtureDialRun(
            structure=structure, numbers=numbers, size=SIZE, environments=structure.environments
        )
        cost = config.updates / 150
        jobs.append(Job(folder_of(seed), train_dial, run, (DEMONSTRATIONS,), cost))
    return jobs


def folder_of(seed: int) -> str:
    """Return the folder of the dial of a training seed."""
    return f"dials/{seed}"
