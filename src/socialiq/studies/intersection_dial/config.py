"""What the study of the dial in the intersection runs; the defaults are the committed results."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from socialiq.errors import UserError
from socialiq.learners.dial.config import Hyperparameters, StaticConfig

STRUCTURE = StaticConfig(
    view="set", hidden=(128, 128), updates=40_000, replay_capacity=200_000, environments=12
)
"""Of dials and agents, but for their ranges and updates: the network of the set experts."""

NUMBERS = Hyperparameters(
    temperature=0.03, discount=0.99, learning_rate=5e-4, final_rate=0.03, exploration=0.05
)
"""Rates of the set experts; an intersection has no clock, hence their discount."""


@dataclass(frozen=True)
class Config:
    """What the study runs; the defaults are the committed results."""

    seeds: tuple[int, ...] = (50, 51, 52, 53, 54)
    """Training seeds, each with a mixture of demonstrations of its own. 120 was used in
    development."""
    key_angles: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 15.0).tolist())
    """Angles that an agent is trained for, and at which regrets are counted, in degrees."""
    turned: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 5.0).tolist())
    """Angles at which a dial is driven; the key angles are among them."""
    structure: StaticConfig = STRUCTURE
    """Of a dial."""
    numbers: Hyperparameters = NUMBERS
    """Of both, but for the seed."""
    agent_updates: int = 12_000
    """Gradient steps of an agent of one angle; all agents of a seed take twice a dial's."""
    steps_per_update: int = 12
    """Environment steps for each gradient step."""
    pool_episodes: int = 3000
    """Episodes recorded of each expert of the atlas, as in the intersection study."""
    mixture: str = "equal_transitions"
    """Of the three experts' demonstrations, as in the intersection study."""
    size: int = 15_000
    """Transitions of each expert in a mixture."""
    episodes: int = 2000
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
