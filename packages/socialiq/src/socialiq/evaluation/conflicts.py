"""Names that the audit still uses; they end with its next change."""

from socialiq.evaluation.episodes import CONFLICT_SECONDS

__all__ = ["CONFLICT_SECONDS"]
