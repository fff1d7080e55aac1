"""What a training run is made of while it runs: the runs' state, and what was recorded."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Int


class Runs(NamedTuple):
    """The state of all runs; every array has a leading run axis.

    Attributes:
        learnt: What training changes and a non-finite loss must not touch.
        surroundings: Random key, replay, episode: whatever else an update carries along.
        updates: Number of updates done.
        failed_at: Update at which the run broke, -1 while it is sound.
        failed_term: Index of the first term that was not finite (in the order of their names).
    """

    learnt: Any
    surroundings: Any
    updates: Int[Array, " run"]
    failed_at: Int[Array, " run"]
    failed_term: Int[Array, " run"]


@dataclass
class History:
    """What was recorded at the end of each chunk; arrays are (chunks, runs)."""

    updates: list[int] = field(default_factory=list)
    values: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(self, updates: int, values: dict[str, np.ndarray]) -> None:
        """Record one chunk."""
        self.updates.append(updates)
        for name in sorted(values):  # the order in which a checkpoint gives them back
            self.values.setdefault(name, []).append(np.asarray(values[name], np.float64))

    def array(self, name: str) -> np.ndarray:
        """One recorded quantity, (chunks, runs)."""
        return np.stack(self.values[name])
