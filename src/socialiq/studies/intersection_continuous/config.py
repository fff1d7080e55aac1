"""Configuration of the study of continuous actions at the intersection."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.experiments.intersection.demonstration_sets import MIXTURE
from socialiq.learners.config import check_counts
from socialiq.learners.continuous.config import (
    Hyperparameters,
    IQHyperparameters,
    IQStaticConfig,
    StaticConfig,
)
from socialiq.learners.dial.config import INTERSECTION
from socialiq.learners.dial.config import Hyperparameters as DiscreteHyperparameters
from socialiq.learners.dial.config import StaticConfig as DiscreteStaticConfig
from socialiq.learners.iq_learn.config import Endings
from socialiq.worlds.intersection.options import ContinuousOptions, Options

STEPS_PER_UPDATE = 12
"""Environment steps for each update, of experts and dials with either kind of actions."""

_NETWORK: dict[str, Any] = {
    "view": "set",
    "hidden": (128, 128),
    "batch_size": 128,
    "endings": Endings(),
}
_NUMBERS: dict[str, Any] = {
    "temperature": 0.03,
    "learning_rate": 2e-3,
    "polyak": 0.03,
    "discount": 0.99,
}

EXPERT = StaticConfig(
    **_NETWORK,
    times=20,
    updates=3_000,
    env_steps_per_update=STEPS_PER_UPDATE,
    updates_per_round=200,
    replay_capacity=40_000,
    schedule="linear",
)
"""Soft actor-critic on R(α), which sees the time."""

DIAL = dataclasses.replace(EXPERT, high_share=0.4)
"""The same, trained at every angle (`plan` makes it a dial), with the angles of the preset of
discrete actions."""

HIGH_ANGLES = dataclasses.replace(DIAL, high_share=0.8)
"""The same with most of its angles beyond 65 degrees; chosen among ten settings in development."""

DISCRETE = dataclasses.replace(
    INTERSECTION.structure,
    hidden=(128, 128),
    replay_batch=128,
    updates=EXPERT.updates,
    replay_capacity=EXPERT.replay_capacity,
)
"""The preset of discrete actions in the continuous dial's budget: its updates, rows, environment
steps and widths; like it, it is trained without demonstrations (`plan`)."""

LEARNER = IQStaticConfig(
    **_NETWORK,
    prior="shifted_chi2",
    chi2_on="mixture",
    updates=1_200,
    env_steps_per_update=2,
    updates_per_round=200,
    replay_capacity=20_000,
    target_kind="instantaneous",
)
"""The preset `intersection-shifted` with an actor; without the time, as its demonstrations."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results.

    Training seeds 100 to 199 and episodes from 50,000,000 on were used in development.
    """

    seeds: tuple[int, ...] = (70, 71, 72)
    """Training seeds of dials with either kind of actions."""
    learner_seeds: tuple[int, ...] = (75, 76)
    """Training seeds of learners, each with a mixture of its own."""
    expert_seed: int = 78
    """Training seed of the three experts."""
    angles: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 15.0).tolist())
    """Angles at which dials are driven, in degrees."""
    expert: StaticConfig = EXPERT
    """Static config of the experts."""
    numbers: Hyperparameters = field(default_factory=lambda: Hyperparameters(**_NUMBERS))
    """Hyperparameters of experts and continuous dials, without angle and seed."""
    continuous: StaticConfig = DIAL
    """Static config of the continuous dials."""
    high_angles: StaticConfig = HIGH_ANGLES
    """Static config of the continuous dials with most angles beyond 65 degrees."""
    discrete: DiscreteStaticConfig = DISCRETE
    """Static config of the discrete dials."""
    discrete_numbers: DiscreteHyperparameters = INTERSECTION.numbers
    """Hyperparameters of the discrete dials, without the seed."""
    learner: IQStaticConfig = LEARNER
    """Static config of the learners; the baseline has no prior."""
    learner_numbers: IQHyperparameters = field(
        default_factory=lambda: IQHyperparameters(
            temperature=0.1, learning_rate=3e-4, prior_weight=5.0
        )
    )
    """Hyperparameters of the learners, without angle, seed and data."""
    options: ContinuousOptions = field(default_factory=ContinuousOptions)
    """Scenario of continuous actions."""
    discrete_options: Options = field(default_factory=lambda: Options(destination="straight"))
    """The same scenario with discrete actions."""
    pool_episodes: int = 1_000
    """Episodes recorded of each expert."""
    mixture: str = MIXTURE
    """Mixture of the three experts' demonstrations, as in the intersection study."""
    size: int = 5_000
    """Transitions of each expert in a mixture."""
    environments: int = 24
    """Episodes side by side in training, of each run."""
    episodes: int = 1_000
    """Evaluation episodes of each policy, common to all."""
    first_episode: int = 21_000_000
    """Seed of the first one."""

    def __post_init__(self) -> None:
        """Refuse empty sizes."""
        if not self.seeds or not self.learner_seeds or not self.angles:
            raise UserError("name at least one training seed, of dials and of learners, and angle")
        check_counts(self, ("pool_episodes", "size", "environments", "episodes"))
