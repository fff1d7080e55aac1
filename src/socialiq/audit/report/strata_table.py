"""The same policy by kind of episode: how much traffic, who crosses, who has right of way."""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.audit.outcomes import Evidence
from socialiq.audit.rare import FEWEST
from socialiq.audit.regret import Regrets
from socialiq.audit.report.drivers import shares
from socialiq.audit.report.selected import value_of

_RESAMPLES = 1000


def strata_rows(
    evidence: Evidence, angle: float, margin: float, error: float, seed: int
) -> list[dict[str, Any]]:
    """One row for each label of each stratification.

    The bounds are each stratum's own, one-sided, and not corrected for their number: they show
    where to look and decide nothing.

    Args:
        evidence: Of the audit.
        angle: Declared, degrees.
        margin: Of regret.
        error: Of each bound.
        seed: Of the resampling.
    """
    rows = []
    for name, labels in evidence.strata.items():
        for label in np.unique(labels).tolist():
            part = evidence.part(labels == label)
            bounds = _regret(part, angle, error, seed)
            rows.append(
                {
                    "stratification": name,
                    "label": str(label),
                    "episodes": part.episodes,
                    "value": float(value_of(part.policy, angle).mean()),
                    **bounds,
                    "over_margin": bounds["low"] is not None and bounds["low"] > margin,
                    **shares(part.policy),
                }
            )
    return rows


def _regret(part: Evidence, angle: float, error: float, seed: int) -> dict[str, Any]:
    """Regret with its bounds; too few episodes give an estimate alone, one alone not even that."""
    if part.episodes < 2:
        return {"regret": None, "low": None, "high": None}
    regrets = Regrets(part, seed, _RESAMPLES)
    if part.episodes < FEWEST:
        return {"regret": regrets.estimate(angle), "low": None, "high": None}
    return {
        "regret": regrets.estimate(angle),
        "low": regrets.low(angle, error),
        "high": regrets.high(angle, error),
    }
