"""The study again with the recorded drivers alone, and with practice in the world.

Recorded drivers show few of the states that their dials get into. Here dials drive in the world
that was made of the same recordings, and learn again from what they met; there are no planted
drivers.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

from socialiq_lab.recorded_practice import Practice
from studies.recorded_junction import ahead, study
from studies.recorded_junction.config import PRACTISED, RECORDED


@dataclass(frozen=True)
class Config(ahead.Config):
    """Configuration of the study; the defaults are the committed results."""

    mixtures: tuple[str, ...] = (RECORDED, PRACTISED)
    """Sets of demonstrations, each with its dials; of `MIXTURES`."""
    seeds: tuple[int, ...] = (2106, 2107, 2108)
    """Training seeds. 100 to 199 were used in development."""
    practice: Practice = field(default_factory=lambda: Practice(5))
    """Practice of the mixture that has it."""
    first_episode: int = 66_000_000
    """Seed of the first evaluation episode. Those from 50,000,000 on were used in development."""


STUDY = dataclasses.replace(study.STUDY, name="recorded-junction-practice", Config=Config)
