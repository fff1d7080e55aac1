"""Jobs of the study: training, settings and driving of every policy."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    atlas_demonstrations,
)
from socialiq_lab.intersection.driving import (
    DialCalibration,
    DialEvaluation,
    PlannedEvaluation,
    calibrate_dial,
    evaluate_calibrated,
    evaluate_dial,
    evaluate_planned,
    evaluate_seeing,
)
from socialiq_lab.intersection.policy_iteration import (
    DialIterationRun,
    train_dial_by_iteration,
)
from socialiq_lab.intersection.training import MixtureDialRun, train_dial
from socialiq_lab.jobs import Job
from studies.intersection_dial.config import (
    AGENTS,
    CALIBRATED,
    DIALS,
    FAMILIES,
    FORESIGHT,
    ITERATED,
    PLANNED,
    TIMED,
    Config,
    Recipe,
)


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    jobs = [atlas_demonstrations(config.pool_episodes)]
    families = [family for family in FAMILIES if family in config.families]
    for seed, family in itertools.product(config.seeds, families):
        name, angles = folder_of(family, seed), config.angles_of(family)
        if family == CALIBRATED:
            jobs += _calibration(config, seed)
        elif family == ITERATED:
            jobs += _iteration(config, seed)
        elif family in (PLANNED, FORESIGHT):
            if seed in config.seeds_of(family):
                jobs.append(_ahead(config, family, seed))
        elif family == AGENTS:
            jobs += _agents(config, seed)
        else:
            jobs += _training(config, config.recipe_of(family), angles, name, seed)
    return jobs


def _agents(config: Config, seed: int) -> Iterator[Job]:
    """Train the agents of a seed, each for one angle, and drive."""
    for angle in config.key_angles:
        one = {"low": angle, "high": angle, "margin": 0.0, "updates": config.agent_updates}
        recipe = Recipe(dataclasses.replace(config.structure, **one), config.numbers)
        yield from _training(config, recipe, (angle,), folder_of(AGENTS, seed, angle), seed)


def folder_of(family: str, seed: int, angle: float = 0.0) -> str:
    """Return the folder of a dial, or of the agent of an angle."""
    if family == AGENTS:
        return f"agents/{angle:g}/{seed}"
    return f"dials/{seed}" if family == DIALS else f"{family}/{seed}"


def _training(
    config: Config, recipe: Recipe, angles: tuple[float, ...], name: str, seed: int
) -> Iterator[Job]:
    """Train, then drive at these angles."""
    structure = recipe.structure
    run = MixtureDialRun(
        structure=structure,
        numbers=dataclasses.replace(recipe.numbers, seed=seed),
        size=config.size,
        steps_per_update=config.steps_per_update,
        environments=structure.environments,
        mixture=config.mixture,
    )
    if len(angles) == 1:
        run = dataclasses.replace(run, check_angles=angles)
    yield Job(name, train_dial, run, (DEMONSTRATIONS,), cost=structure.updates / 150)
    yield _driving(config, name, angles)


def _calibration(config: Config, seed: int) -> Iterator[Job]:
    """Select a dial's settings on episodes of their own, then drive."""
    name, trained = folder_of(CALIBRATED, seed), folder_of(TIMED, seed)
    told = DialCalibration(config.turned, episodes=config.calibration_episodes)
    yield Job(name, calibrate_dial, told, (trained,), cost=3.0 * len(config.turned))
    driving = DialEvaluation(config.turned, episodes=config.episodes)
    inputs = (name, f"evaluation/{trained}")
    yield Job(f"evaluation/{name}", evaluate_calibrated, driving, inputs)


def _iteration(config: Config, seed: int) -> Iterator[Job]:
    """Improve a dial by policy iteration, then drive."""
    name, structure = folder_of(ITERATED, seed), config.iteration
    run = DialIterationRun(structure, dataclasses.replace(config.iteration_numbers, seed=seed))
    inputs = (folder_of(TIMED, seed),)
    yield Job(name, train_dial_by_iteration, run, inputs, cost=structure.updates / 20)
    yield _driving(config, name, config.turned)


def _ahead(config: Config, family: str, seed: int) -> Job:
    """Drive a dial with online planning, or with one look at the true future."""
    work, seconds = (evaluate_planned, 140.0) if family == PLANNED else (evaluate_seeing, 15.0)
    kind = PlannedEvaluation if family == PLANNED else DialEvaluation
    driving = kind(config.key_angles, episodes=config.episodes)
    cost, trained = seconds * len(config.key_angles), folder_of(TIMED, seed)
    return Job(f"evaluation/{folder_of(family, seed)}", work, driving, (trained,), cost)


def _driving(config: Config, name: str, angles: tuple[float, ...]) -> Job:
    driving = DialEvaluation(angles, episodes=config.episodes)
    return Job(f"evaluation/{name}", evaluate_dial, driving, (name,), cost=3.0 * len(angles))
