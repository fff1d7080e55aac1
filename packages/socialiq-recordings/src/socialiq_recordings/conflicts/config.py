"""Options of conflicts."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from socialiq.errors import UserError


@dataclass(frozen=True)
class ConflictConfig:
    """Options of conflicts.

    Attributes:
        near: s. Times in a conflict area that are further apart are no conflict: the threshold of
            PET in FHWA's surrogate safety assessment model (FHWA-HRT-08-051, 2008).
        horizon: s ahead in which both must arrive at their present speeds.
        queued: Whether vehicles behind others of their lane are in conflict with crossing traffic.
        slack: m by which vehicles are narrower than recorded, since boxes from video err.
    """

    near: float = 5.0
    horizon: float = 10.0
    queued: bool = False
    slack: float = 0.3

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self) if field.name != "queued"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise UserError(f"{name} must be a number of at least 0, got {value}")
