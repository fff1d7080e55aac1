"""Names that the audit still uses; they end with its next change."""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.evaluation.simulate import GymActor, GymSimulator
from socialiq.worlds.enumerate import GridBatch, Table

__all__ = ["FixedChance", "GymActor", "GymSimulator", "TableSimulator"]


class FixedChance:
    """Chance from uniform numbers that are fixed for each episode and time."""

    def __init__(self, uniform: np.ndarray) -> None:
        self.uniform = uniform


class TableSimulator(GridBatch):
    """Episodes of a gridworld whose chance is fixed."""

    def __init__(self, table: Table, episodes: int, chance: FixedChance) -> None:
        super().__init__(table, episodes)
        self._uniform = chance.uniform

    def fate_of(self, seed: int) -> Any:
        """Return the chance of an episode, by its number."""
        return self._uniform[seed]
