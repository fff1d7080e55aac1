"""Configuration of the study, and the recipes of its dials."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.learners.dial.config import INTERSECTION, DialConfig, DialHyperparameters
from socialiq.learners.policy_iteration import dial as dial_iteration
from socialiq.learners.policy_iteration import train as policy_iteration
from socialiq.learners.settings import check_counts
from socialiq_lab.intersection.demonstration_sets import (
    MIXTURE,
    RECORDED_EPISODES,
    SIZE,
)
from socialiq_lab.intersection.episodes import EPISODES
from socialiq_lab.intersection.policy_iteration import ITERATION, ITERATION_NUMBERS
from socialiq_lab.intersection.training import DIAL_NUMBERS, DIAL_STRUCTURE

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

_NAMES = {one.name for one in dataclasses.fields(DialConfig)}


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
    """DialHyperparameters of dials and agents, without the seed."""
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
    """DialHyperparameters of these dials, without the seed."""
    iteration: dial_iteration.DialIterationConfig = ITERATION
    """Static config of the policy iteration that begins with such a dial."""
    iteration_numbers: policy_iteration.IterationHyperparameters = ITERATION_NUMBERS
    """DialHyperparameters of it, without the seed."""
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
