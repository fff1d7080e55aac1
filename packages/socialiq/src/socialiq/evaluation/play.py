"""Names that the audit still uses; they end with its next change."""

from __future__ import annotations

from socialiq.evaluation.simulate import play
from socialiq.worlds.highway.episodes import RoadBatch

__all__ = ["BatchSimulator", "play"]


def BatchSimulator(batch: RoadBatch) -> RoadBatch:  # noqa: N802
    """Return the batch, which is a simulator."""
    return batch
