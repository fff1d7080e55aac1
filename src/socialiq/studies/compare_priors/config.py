"""Configuration of the comparison; the defaults are the committed results."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from socialiq.errors import UserError, one_of
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets
from socialiq.studies.compare_priors.methods import BY_NAME

GRIDWORLDS = ("crossing5", "crossing7")
WORLDS = (*GRIDWORLDS, "intersection")

FASTER = 3
"""A third of the updates of 6.2, each three times as long: the whole table costs a third."""

EPISODES_EACH = {"crossing5": 1, "crossing7": 60}
"""Episodes of each expert, as in the worlds' own studies; the 5x5 world has no chance in it."""


@dataclass(frozen=True)
class Config:
    """One budget and the same seeds for every method of a world."""

    worlds: tuple[str, ...] = GRIDWORLDS
    """Worlds of the comparison; the intersection takes hours and is left out if not named."""
    methods: tuple[str, ...] = tuple(BY_NAME)
    """Rows."""
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """Target angles in degrees, in the gridworlds."""
    development_angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Angles at which λ is chosen, and all angles of the intersection."""
    strengths: tuple[float, ...] = (1.0, 3.0, 10.0)
    """λ that can be chosen, or 1/τ_w."""
    development_seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Training seeds on which λ is chosen, each with a data set of its own."""
    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds of the table, each with a data set of its own."""
    updates: int = presets.GRID.updates // FASTER
    """Gradient steps in the gridworlds, and as many steps in the world."""
    learning_rate: float = FASTER * presets.TABLE_C1_NUMBERS.learning_rate
    polyak: float = FASTER * presets.TABLE_C1_NUMBERS.polyak
    intersection_strengths: tuple[float, ...] = (1.0, 3.0)
    """λ that can be chosen in the intersection."""
    intersection_development_seeds: tuple[int, ...] = (0,)
    """Training seeds there, fewer because a run takes the better part of a minute."""
    intersection_seeds: tuple[int, ...] = (10, 11, 12)
    """Training seeds of the intersection's table."""
    intersection_updates: int = 4_000
    """Gradient steps of every method in the intersection, half of the study's."""
    episodes: int = 2000
    """Evaluation episodes of each policy in the intersection."""

    def __post_init__(self) -> None:
        """Refuse unknown worlds and methods, and what makes no run."""
        for world in self.worlds:
            one_of("world", world, WORLDS)
        for method in self.methods:
            one_of("method", method, tuple(BY_NAME))
        for name, value in vars(self).items():
            if isinstance(value, tuple) and not value:
                raise UserError(f"{name} must name at least one")
        if len({*self.worlds}) < len(self.worlds):
            raise UserError("a world is named twice: name each once")
        if self._fresh & {*self.development_seeds, *self.intersection_development_seeds}:
            raise UserError("a seed of development can't be a seed of the table: name others")

    @property
    def _fresh(self) -> set[int]:
        return {*self.seeds, *self.intersection_seeds}

    @property
    def structure(self) -> iq.StaticConfig:
        """Network, data and budget of the gridworlds: Table C.1's, but for the updates."""
        return dataclasses.replace(presets.TABLE_C1, updates=self.updates)

    @property
    def numbers(self) -> iq.Hyperparameters:
        """The numbers that all lanes of the gridworlds share."""
        return dataclasses.replace(
            presets.TABLE_C1_NUMBERS, learning_rate=self.learning_rate, polyak=self.polyak
        )
