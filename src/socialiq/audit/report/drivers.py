"""Drivers as rows of the report: what they earn, how their episodes end."""

from __future__ import annotations

from typing import Any

from socialiq.audit.outcomes import Outcomes
from socialiq.audit.report.selected import value_of
from socialiq.audit.safety_floor import events_of


def shares(driver: Outcomes) -> dict[str, float]:
    """Shares of episodes by how they end."""
    return {name: float(happened.mean()) for name, happened in events_of(driver).items()}


def driver_row(driver: Outcomes, angle: float) -> dict[str, Any]:
    """One driver's means.

    Args:
        driver: Who drove.
        angle: Declared, degrees; `value` is the mean R(α) there.
    """
    return {
        "name": driver.name,
        "angles": list(driver.angles),
        "r_env": driver.mean.env,
        "r_social": driver.mean.social,
        "value": float(value_of(driver, angle).mean()),
        "expected": None if driver.expected is None else driver.expected._asdict(),
        **shares(driver),
        "decisions": float(driver.length.mean()),
    }
