"""Configuration of the study of continuous actions at the intersection."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from socialiq.errors import UserError
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.continuous.config import (
    DIAL,
    EXPERT,
    EXPERT_NUMBERS,
    LEARNER,
    LEARNER_NUMBERS,
    LONGER,
    LONGER_NUMBERS,
    ActorIQLearnConfig,
    ActorIQLearnHyperparameters,
    SACConfig,
    SACHyperparameters,
    TD3BCConfig,
    TD3BCHyperparameters,
)
from socialiq.learners.dial.config import INTERSECTION
from socialiq.learners.dial.config import DialConfig as DiscreteStaticConfig
from socialiq.learners.dial.config import DialHyperparameters as DiscreteHyperparameters
from socialiq.learners.settings import check_counts
from socialiq.worlds.intersection.options import ContinuousOptions, Options
from socialiq_lab.intersection.demonstration_sets import MIXTURE

HIGH_ANGLES = dataclasses.replace(DIAL, high_share=0.8)
"""The dial with most of its angles beyond 65 degrees; chosen among ten settings in development."""

_NETWORK = {name: getattr(LEARNER, name) for name in ("view", "hidden", "batch_size")}

CLONE = bc.CloningConfig(**_NETWORK, updates=EXPERT.updates)
CLONE_NUMBERS = bc.CloningHyperparameters(learning_rate=1e-3)
"""Behaviour cloning, once of all demonstrations alike and once weighted (Eq B.2); its rate was
chosen in development."""

TD3_BC = TD3BCConfig(**_NETWORK, updates=EXPERT.updates, endings=LEARNER.endings)
TD3_BC_NUMBERS = TD3BCHyperparameters()
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
    expert: SACConfig = EXPERT
    """Static config of the experts."""
    numbers: SACHyperparameters = EXPERT_NUMBERS
    """SACHyperparameters of experts and continuous dials, without angle and seed."""
    continuous: SACConfig = DIAL
    """Static config of the continuous dials."""
    high_angles: SACConfig = HIGH_ANGLES
    """Static config of the continuous dials with most angles beyond 65 degrees."""
    discrete: DiscreteStaticConfig = DISCRETE
    """Static config of the discrete dials."""
    discrete_numbers: DiscreteHyperparameters = INTERSECTION.numbers
    """SACHyperparameters of the discrete dials, without the seed."""
    learner: ActorIQLearnConfig = LEARNER
    """Static config of the learners; the baseline has no prior."""
    learner_numbers: ActorIQLearnHyperparameters = LEARNER_NUMBERS
    """SACHyperparameters of the learners, without angle, seed and data."""
    longer: ActorIQLearnConfig = LONGER
    """Static config of learners with as many updates as clones."""
    longer_numbers: ActorIQLearnHyperparameters = LONGER_NUMBERS
    """SACHyperparameters of these, without angle, seed and data."""
    clone: bc.CloningConfig = CLONE
    """Static config of the clones."""
    clone_numbers: bc.CloningHyperparameters = CLONE_NUMBERS
    """SACHyperparameters of the clones, without angle, seed and data."""
    td3_bc: TD3BCConfig = TD3_BC
    """Static config of TD3+BC."""
    td3_bc_numbers: TD3BCHyperparameters = TD3_BC_NUMBERS
    """SACHyperparameters of TD3+BC, without angle, seed and data."""
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
