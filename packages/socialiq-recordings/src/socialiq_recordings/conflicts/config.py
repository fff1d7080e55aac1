"""Options of conflicts and of reasoned influence."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from socialiq.errors import UserError
from socialiq_recordings.conflicts.idm import Idm


@dataclass(frozen=True)
class ConflictConfig:
    """Options of conflicts.

    Attributes:
        near: s. Times in a conflict area that are further apart are no conflict: the threshold of
            PET in FHWA's surrogate safety assessment model (FHWA-HRT-08-051, 2008).
        horizon: s ahead in which both must arrive at their present speeds.
        queued: Whether vehicles behind others of their lane are in conflict with crossing traffic.
        slack: m by which vehicles are narrower than recorded, since boxes from video err.
        lookback: s before a braking from which the counterfactual begins: a reaction time.
        changed: m/s; the smallest difference of speeds that the counterfactual must make.
        slowed: m/s; a leader moved first if it lost this much before its follower did.
        driver: Parameters of the car-following model.
    """

    near: float = 5.0
    horizon: float = 10.0
    queued: bool = False
    slack: float = 0.3
    lookback: float = 1.0
    changed: float = 0.5
    slowed: float = 0.5
    driver: Idm = field(default_factory=Idm)

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if one.name not in ("driver", "queued") and not (math.isfinite(value) and value >= 0):
                raise UserError(f"{one.name} must be a number of at least 0, got {value}")
