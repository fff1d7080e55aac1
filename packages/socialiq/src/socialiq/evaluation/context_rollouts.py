"""Names that the audit still uses; they end with its next change."""

from socialiq.evaluation.context import losses_of

__all__ = ["losses_of"]
