"""Configuration of the study of continuous actions at the intersection."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from socialiq.errors import UserError
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.config import check_counts
from socialiq.learners.continuous.config import (
    Hyperparameters,
    IQHyperparameters,
    IQStaticConfig,
    OfflineHyperparameters,
    OfflineStaticConfig,
    StaticConfig,
)
from socialiq.learners.continuous.presets import (
    DIAL,
    EXPERT,
    EXPERT_NUMBERS,
    LEARNER,
    LEARNER_NUMBERS,
    LONGER,
    LONGER_NUMBERS,
)
from socialiq.learners.dial.config import INTERSECTION
from socialiq.learners.dial.config import Hyperparameters as DiscreteHyperparameters
from socialiq.learners.dial.config import StaticConfig as DiscreteStaticConfig
from socialiq.worlds.intersection.options import ContinuousOptions, Options
from socialiq_lab.intersection.demonstration_sets import MIXTURE

HIGH_ANGLES = dataclasses.replace(DIAL, high_share=0.8)
"""The dial with most of its angles beyond 65 degrees; chosen among ten settings in development."""

_NETWORK = {name: getattr(LEARNER, name) for name in ("view", "hidden", "batch_size")}

CLONE = bc.StaticConfig(**_NETWORK, updates=EXPERT.updates)
CLONE_NUMBERS = bc.Hyperparameters(learning_rate=1e-3)
"""Behaviour cloning, once of all demonstrations alike and once weighted (Eq B.2); its rate was
chosen in development."""

TD3_BC = OfflineStaticConfig(**_NETWORK, updates=EXPERT.updates, endings=LEARNER.endings)
TD3_BC_NUMBERS = OfflineHyperparameters()
"""TD3+BC on R(α), with the paper's numbers."""

DISCRETE = dataclasses.replace(
    INTERSECTION.structure,
    hidden=(128, 128),
    replay_batch=128,
    updates=EXPERT.updates,
    replay_capacity=EXPERT.replay_capacity,
)
"""The preset of discrete actions in the continuous dial's budget: its updates, rows, environment
steps and widths; like it, it is trained without demonstrations (`plan`)."""


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
    numbers: Hyperparameters = EXPERT_NUMBERS
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
    learner_numbers: IQHyperparameters = LEARNER_NUMBERS
    """Hyperparameters of the learners, without angle, seed and data."""
    longer: IQStaticConfig = LONGER
    """Static config of learners with as many updates as clones."""
    longer_numbers: IQHyperparameters = LONGER_NUMBERS
    """Hyperparameters of these, without angle, seed and data."""
    clone: bc.StaticConfig = CLONE
    """Static config of the clones."""
    clone_numbers: bc.Hyperparameters = CLONE_NUMBERS
    """Hyperparameters of the clones, without angle, seed and data."""
    td3_bc: OfflineStaticConfig = TD3_BC
    """Static config of TD3+BC."""
    td3_bc_numbers: OfflineHyperparameters = TD3_BC_NUMBERS
    """Hyperparameters of TD3+BC, without angle, seed and data."""
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
