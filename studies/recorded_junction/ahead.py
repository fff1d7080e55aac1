"""The study again with networks that see how close others come, and with more demonstrations.

Dials of `recorded-junction` turn and collide. Here networks see the closeness of the next seconds
(`nn.view.closeness`). Another mixture is learned without it, to tell what of the two helps.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

from socialiq.learners.offline.config import StaticConfig
from studies.recorded_junction import config, study
from studies.recorded_junction.config import BOTH, PLANTED, RECORDED, SET


@dataclass(frozen=True)
class Config(config.Config):
    """Configuration of the study; the defaults are the committed results."""

    mixtures: tuple[str, ...] = (BOTH, SET, PLANTED, RECORDED)
    """Sets of demonstrations, each with its dials; of `MIXTURES`."""
    seeds: tuple[int, ...] = (2103, 2104, 2105)
    """Training seeds. 100 to 199 were used in development."""
    angles: tuple[float, ...] = (0.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """Angles at which dials are driven, in degrees."""
    planted_episodes: int = 600
    """Episodes of each planted driver."""
    first_planted: int = 63_000_000
    """Seed of the first of these episodes."""
    structure: StaticConfig = field(
        default_factory=lambda: StaticConfig(updates=1500, view="set_ahead")
    )
    """Static config of the dials, without the length of an episode, which is the world's."""
    episodes: int = 400
    """Evaluation episodes of each driver, common to all."""
    checked: int = 30
    """Episodes of each mixture's first dial in whose states values are compared with rollouts."""
    first_episode: int = 64_000_000
    """Seed of the first evaluation episode. Those from 50,000,000 on were used in development."""


STUDY = dataclasses.replace(study.STUDY, name="recorded-junction-ahead", Config=Config)
