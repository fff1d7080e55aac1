"""Configuration of the intersection study: parts, sizes, seeds; the defaults are the results."""

from __future__ import annotations

from dataclasses import dataclass

from socialiq.demonstrations.mixture import MIXTURES
from socialiq.errors import UserError, one_of
from socialiq.experiments.intersection.demonstration_sets import MIXTURE, RECORDED_EPISODES, SIZE
from socialiq.experiments.intersection.experts import EXPERT_STEPS
from socialiq.experiments.intersection.jobs import EPISODES, HIGHWAY_EPISODES
from socialiq.learners.iq_learn import presets

PARTS = ("main", "strengths", "targets", "data", "timeouts", "views")
"""Parts of the study.

- main: an expert trio, its demonstrations, the thesis' preset and the calibrated one with five
  training seeds, every policy and driver evaluated: Tables 6.1, 6.2, A.1, A.2, Figs 6.5, A.1.
- strengths: lambda raised until the angle stops moving.
- targets: kinds of target, temperatures, values of ending.
- data: how much demonstration is needed, and which mixture.
- timeouts: experts who bootstrap through the end of time.
- views: what of a network that sees a set of vehicles makes the difference.
"""


@dataclass(frozen=True)
class Config:
    """Configuration of the study. Seeds below 10, 20 and above 100 were used in development."""

    parts: tuple[str, ...] = PARTS
    """Parts to run; main is always among them."""
    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds of learners, each with a mixture of its own."""
    expert_seed: int = 40
    """Training seed of the expert trio that gives the demonstrations."""
    ablation_seeds: tuple[int, ...] = (30, 31)
    """Training seeds of the ablations."""
    expert_steps: int = EXPERT_STEPS
    """Environment steps of the trio (thesis 5.2)."""
    view_steps: int = 600_000
    """Environment steps of the ablation of views."""
    updates: int = presets.INTERSECTION_THESIS.updates
    """Gradient steps of a learner."""
    ablation_updates: int = 4_000
    """Gradient steps of a learner in the parts targets and data."""
    pool_episodes: int = RECORDED_EPISODES
    """Episodes recorded of each expert."""
    mixture: str = MIXTURE
    """Unit of which each expert has an equal number; 6.3 says transitions."""
    size: int = SIZE
    """Transitions of each expert in a mixture, or episodes with mixture "equal_trajectories"."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the same for all."""
    evaluation_seeds: int = 5
    """Groups of evaluation episodes, as the thesis' five evaluation seeds."""
    group_episodes: int = 100
    """Episodes of a group; the thesis doesn't say how many it played."""
    highway_episodes: int = HIGHWAY_EPISODES
    """Episodes of each final policy on the real highway-env; 0 leaves that out."""

    def __post_init__(self) -> None:
        """Refuse unknown parts and empty sizes."""
        for part in self.parts:
            one_of("part", part, PARTS)
        one_of("mixture", self.mixture, tuple(MIXTURES))
        for name, value in vars(self).items():
            least = 0 if name in ("highway_episodes", "expert_seed") else 1
            if isinstance(value, int) and value < least:
                raise UserError(f"{name} must be at least {least}, got {value}")
            if isinstance(value, tuple) and not value:
                raise UserError(f"{name} must name at least one")
