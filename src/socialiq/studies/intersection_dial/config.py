"""Configuration of the dial's study in the intersection; the defaults are the results."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from socialiq.errors import UserError
from socialiq.experiments.intersection.demonstration_sets import MIXTURE, RECORDED_EPISODES, SIZE
from socialiq.experiments.intersection.dial_jobs import NUMBERS, STRUCTURE
from socialiq.experiments.intersection.jobs import EPISODES
from socialiq.learners.dial.config import Hyperparameters, StaticConfig


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
    structure: StaticConfig = STRUCTURE
    """Static config of a dial."""
    numbers: Hyperparameters = NUMBERS
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

    def __post_init__(self) -> None:
        """Refuse key angles at which no dial is driven, and what makes no run."""
        if not self.seeds:
            raise UserError("name at least one training seed")
        if not set(self.key_angles) <= set(self.turned):
            raise UserError("every key angle must be among the angles at which a dial is driven")
        for name in ("agent_updates", "steps_per_update", "pool_episodes", "size", "episodes"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} must be at least 1, got {getattr(self, name)}")
