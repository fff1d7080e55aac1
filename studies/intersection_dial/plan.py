"""Jobs of the study: training, settings and driving of every policy."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.evaluation.road_training import ITERATION, ITERATION_NUMBERS
from socialiq.learners import policy_iteration
from socialiq.learners.dial.config import INTERSECTION, DialConfig, DialHyperparameters
from socialiq.learners.settings import check_counts
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    MIXTURE,
    RECORDED_EPISODES,
    SIZE,
    atlas_demonstrations,
)
from socialiq_lab.intersection.driving import (
    EPISODES,
    DialCalibration,
    DialEvaluation,
    PlannedEvaluation,
    calibrate_dial,
    evaluate_calibrated,
    evaluate_dial,
    evaluate_planned,
    evaluate_seeing,
)
from socialiq_lab.intersection.training import (
    DIAL_NUMBERS,
    DIAL_STRUCTURE,
    DialIterationRun,
    MixtureDialRun,
    train_dial,
    train_dial_by_iteration,
)
from socialiq_lab.jobs import Job

DIALS, AGENTS, TIMED, CALIBRATED, SHORT = "dial", "agents", "timed", "calibrated", "short"
ITERATED, PLANNED, FORESIGHT = "iterated", "planned", "foresight"

ABLATIONS: dict[str, dict[str, Any]] = {
    SHORT: {},
    "hidden_time": {"redraw_times": 0, "timeout_reward": 0.0, "discount": 0.99},
    "starved_angles": {"high_share": None, "driven_share": 0.0},
    "both_causes": {
        "redraw_times": 0,
        "timeout_reward": 0.0,
        "discount": 0.99,
        "high_share": None,
        "driven_share": 0.0,
    },
    "scores": {"heads": "score"},
    "soft_backup": {"heads": "score", "backup": "soft"},
    "slow_rates": {"learning_rate": 5e-4, "polyak": 0.01},
}
"""Dials of `ablation_updates`, and what of the recipe each changes; the first changes nothing."""

FAMILIES = (DIALS, AGENTS, TIMED, CALIBRATED, ITERATED, PLANNED, FORESIGHT, *ABLATIONS)
"""Kinds of policies: dials and agents without a clock, the recipe's dials with it, the same with
settings of their angles, improved by policy iteration, with online planning and with one look at
the true future, which makes no policy, and the ablations."""

_NAMES = {field.name for field in dataclasses.fields(DialConfig)}


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (50, 51, 52, 53, 54)
    """Training seeds, each with a mixture of demonstrations of its own. 120 was used in
    development."""
    key_angles: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 15.0).tolist())
    """Angles that an agent is trained for, and at which regrets are counted, in degrees."""
    turned: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 5.0).tolist())
    """Angles at which a dial is driven; the key angles are among them."""
    structure: DialConfig = DIAL_STRUCTURE
    """Static config of a dial."""
    numbers: DialHyperparameters = DIAL_NUMBERS
    """Hyperparameters of dials and agents, without the seed."""
    agent_updates: int = 12_000
    """Gradient steps of an agent of one angle; all agents of a seed take twice a dial's."""
    steps_per_update: int = 12
    """Environment steps for each gradient step."""
    pool_episodes: int = RECORDED_EPISODES
    """Episodes recorded of each expert of the atlas, as in the intersection study."""
    mixture: str = MIXTURE
    """Mixture of the three experts' demonstrations, as in the intersection study."""
    size: int = SIZE
    """Transitions of each expert in a mixture."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the intersection study's own."""

    families: tuple[str, ...] = (DIALS, AGENTS)
    """Families that are trained and driven, of `FAMILIES`."""
    recipe: DialConfig = INTERSECTION.structure
    """Static config of a dial with a clock."""
    recipe_numbers: DialHyperparameters = INTERSECTION.numbers
    """Hyperparameters of these dials, without the seed."""
    iteration: policy_iteration.DialIterationConfig = ITERATION
    """Static config of the policy iteration that begins with such a dial."""
    iteration_numbers: policy_iteration.IterationHyperparameters = ITERATION_NUMBERS
    """Hyperparameters of it, without the seed."""
    ablation_updates: int = 6_000
    """Gradient steps of each ablation."""
    planned_seeds: int = 1
    """Training seeds, the first ones, whose dials also drive with online planning or foresight."""
    calibration_episodes: int = EPISODES
    """Episodes of each angle, of their own, that select a dial's settings."""

    def __post_init__(self) -> None:
        """Refuse empty sizes, and key angles at which no dial is driven."""
        if not self.seeds:
            raise UserError("name at least one training seed")
        if not set(self.key_angles) <= set(self.turned):
            raise UserError("every key angle must be among the angles at which a dial is driven")
        for family in self.families:
            one_of("family", family, FAMILIES)
        for family in (CALIBRATED, ITERATED, PLANNED, FORESIGHT):
            if family in self.families and TIMED not in self.families:
                raise UserError(f"a {family} dial is made of a {TIMED} one: name both families")
        counts = ("agent_updates", "steps_per_update", "pool_episodes", "size", "episodes")
        check_counts(self, (*counts, "ablation_updates", "calibration_episodes", "planned_seeds"))

    def seeds_of(self, family: str) -> tuple[int, ...]:
        """Return the training seeds of a family."""
        few = family in (PLANNED, FORESIGHT)
        return self.seeds[: self.planned_seeds] if few else self.seeds

    def angles_of(self, family: str) -> tuple[float, ...]:
        """Return the angles at which a family is driven."""
        few = family in (AGENTS, PLANNED, FORESIGHT) or family in ABLATIONS
        return self.key_angles if few else self.turned

    def recipe_of(self, family: str) -> Recipe:
        """Return how the dials of a family are trained."""
        if family == DIALS:
            return Recipe(self.structure, self.numbers)
        if family == TIMED:
            return Recipe(self.recipe, self.recipe_numbers)
        changes = ABLATIONS[family]
        of_structure = {name: value for name, value in changes.items() if name in _NAMES}
        of_numbers = {name: value for name, value in changes.items() if name not in _NAMES}
        return Recipe(
            dataclasses.replace(self.recipe, updates=self.ablation_updates, **of_structure),
            dataclasses.replace(self.recipe_numbers, **of_numbers),
        )


class Recipe(NamedTuple):
    """Training of the dials of a family."""

    structure: DialConfig
    numbers: DialHyperparameters


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
        changes = {"low": angle, "high": angle, "margin": 0.0, "updates": config.agent_updates}
        recipe = Recipe(dataclasses.replace(config.structure, **changes), config.numbers)
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
