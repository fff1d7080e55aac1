"""Jobs of the study of dials' zeros: training, realised rewards, projections and populations."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.learners.dial.config import INTERSECTION
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import read_json, write_json
from socialiq.types import Row
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    RECORDED_EPISODES,
    SIZE,
    atlas_demonstrations,
)
from socialiq_lab.intersection.episodes import DIAL as DIAL_FILE
from socialiq_lab.intersection.training import MixtureDialRun, train_dial
from socialiq_lab.jobs import Job, ProgressCallback
from socialiq_recordings.trait.contrasts import contrasts
from studies.angle_trait.common_scale import Realised, mean_of
from studies.angle_trait.config import DIAL, OTHER_DIAL
from studies.angle_trait.driving import Population, drive
from studies.angle_trait.ensemble import Member, common_angle, fit_dials, likeliest
from studies.angle_trait.zeros_config import CALIBRATED, PLAIN, Config

FOUND = "found.json"
"""File of what a job found."""

STEP = 7.5
"""Distance of the angles of a common scale, degrees."""

PLANTED = 15.0
"""Distance of the angles that are projected, degrees."""

_ZEROS, _POPULATIONS = 100_000, 200_000  # first episodes of these jobs, after those of the scale
_PACKAGED = {PLAIN: DIAL, CALIBRATED: OTHER_DIAL}


@dataclass(frozen=True)
class Task:
    """Episodes of one dial.

    Attributes:
        dial: Its name.
        models: Names of the dials that are compared with it, or a family that is its model.
        first: Seed of the first episode.
        episodes: Number of episodes, of each angle or driver.
        planted: Angles of the drivers, degrees.
    """

    dial: str
    models: tuple[str, ...]
    first: int
    episodes: int
    planted: tuple[float, ...] = ()


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    jobs = [atlas_demonstrations(RECORDED_EPISODES)]
    structure = dataclasses.replace(INTERSECTION.structure, updates=config.updates)
    for seed in config.dials:
        numbers = dataclasses.replace(INTERSECTION.numbers, seed=seed)
        run = MixtureDialRun(
            structure=structure, numbers=numbers, size=SIZE, environments=structure.environments
        )
        cost = config.updates / 150
        jobs.append(Job(folder_of("dials", str(seed)), train_dial, run, (DEMONSTRATIONS,), cost))
    for name in config.names:
        task = Task(name, (), config.first_episode, config.scale_episodes)
        jobs.append(Job(folder_of("realised", name), realise, task, _dials(name), 3.0))
    for number, name in enumerate((*config.family_of(""), PLAIN)):
        others = tuple(one for one in config.names if one not in (name, CALIBRATED))
        others += (CALIBRATED,) if name == PLAIN else ()
        planted = tuple(np.arange(0.0, 90.1, PLANTED).tolist())
        first = config.first_episode + _ZEROS + number * len(planted) * config.zero_episodes
        task = Task(name, others, first, config.zero_episodes, planted)
        jobs.append(Job(folder_of("zeros", name), project, task, _inputs(name, others), 10.0))
    return jobs + _population_jobs(config)


def _population_jobs(config: Config) -> list[Job]:
    jobs, driving = [], (*config.family_of(""), PLAIN)
    cells = [(name, spread) for name in driving for spread in config.spreads]
    for number, (name, spread) in enumerate(cells):
        first = config.first_episode + _POPULATIONS + number * config.drivers * config.episodes
        drawn = np.random.default_rng(first).standard_normal(config.drivers)
        planted = tuple((config.mean + spread * drawn).clip(0.0, 90.0).tolist())
        family = config.family_of(name)
        task = Task(name, family, first, config.episodes, planted)
        folder = folder_of(f"populations/{spread:g}", name)
        jobs.append(Job(folder, populate, task, _inputs(name, family), 15.0))
    return jobs


def folder_of(stage: str, name: str) -> str:
    """Return the folder of a job about a dial."""
    return f"{stage}/{name.replace(' ', '-')}"


def _dials(*names: str) -> tuple[str, ...]:
    return tuple(folder_of("dials", one) for one in names if one not in _PACKAGED)


def _inputs(name: str, others: tuple[str, ...]) -> tuple[str, ...]:
    names = (name, *others)
    return (*_dials(*names), *(folder_of("realised", one) for one in names))


def dial_of(name: str, inputs: Mapping[str, Path]) -> DialPolicy:
    """Return a dial by its name: a trained one, or one that came with the package."""
    trained = _PACKAGED.get(name)
    return DialPolicy.load(trained or inputs[folder_of("dials", name)] / DIAL_FILE)


def member_of(name: str, inputs: Mapping[str, Path]) -> Member:
    """Return a dial with what it realises."""
    found = read_json(inputs[folder_of("realised", name)] / FOUND)
    return Member(dial_of(name, inputs), Realised(*(np.array(column) for column in found)))


def realise(
    task: Task, folder: Path, inputs: Mapping[str, Path], _on_progress: ProgressCallback
) -> None:
    """Write the mean rewards of a dial at its angles."""
    found = Realised.of(dial_of(task.dial, inputs), task.episodes, task.first, STEP)
    write_json(folder / FOUND, [column.tolist() for column in found])


def project(
    task: Task, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the likeliest angles of other dials for a dial's policies."""
    mine, planted = member_of(task.dial, inputs), np.array(task.planted)
    population = Population("dial", planted, 0.0)
    decided = drive(population, mine.dial, task.episodes, task.first)
    social = mine.realised.social_at(planted)
    rows: list[Row] = []
    for number, name in enumerate(task.models, start=1):
        model = member_of(name, inputs)
        matched = model.realised.angle_of(social)
        found = likeliest(decided, task.episodes, model.dial, model.realised.angle)
        columns = zip(planted.tolist(), social.tolist(), matched.tolist(), found, strict=True)
        rows += [
            {"driver": task.dial, "model": name, "planted": a, "r_social": s, "matched": m} | row
            for a, s, m, row in columns
        ]
        on_progress(number / len(task.models))
    write_json(folder / FOUND, rows)


def populate(
    task: Task, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a population's posteriors by a family of dials, and what predicts second halves."""
    mine, planted = member_of(task.dial, inputs), np.array(task.planted)
    family = [member_of(name, inputs) for name in task.models]
    decided = drive(Population("dial", planted, 0.0), mine.dial, task.episodes, task.first)
    on_progress(0.3)
    models = fit_dials(decided, task.episodes, task.episodes, family, task.first, STEP)
    angle = planted[models.sample.identity]
    reference = mean_of([one.realised for one in family])
    found: dict[str, Any] = {
        "planted": angle.tolist(),
        "planted_common": common_angle(mine, angle, reference).tolist(),
        "common": models.trait.value.tolist(),
        "posterior": models.angle.drivers.sum(axis=1).tolist(),
        "reference": [column.tolist() for column in reference],
        "tests": contrasts(models, task.first % 2**31),
    }
    write_json(folder / FOUND, found)
