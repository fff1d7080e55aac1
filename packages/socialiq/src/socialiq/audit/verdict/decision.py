"""Pass, fail or inconclusive: of one test, of several, and how many episodes would decide."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable

POWER = 0.9
"""Chance of a decision with the number of `episodes_needed`, if the estimate is true."""


class Decision(enum.Enum):
    """Outcome of a test, and of the whole audit."""

    PASS = "pass"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


def decide(low: float, high: float, limit: float) -> Decision:
    """Compare an interval with the largest value allowed.

    Args:
        low: One-sided lower bound.
        high: One-sided upper bound.
        limit: Largest value that passes.
    """
    if high <= limit:
        return Decision.PASS
    return Decision.FAIL if low > limit else Decision.INCONCLUSIVE


def joint_decision(decisions: Iterable[Decision]) -> Decision:
    """Return PASS if all tests pass, FAIL if any fails, else INCONCLUSIVE."""
    found = set(decisions)
    if Decision.FAIL in found:
        return Decision.FAIL
    return Decision.PASS if found == {Decision.PASS} else Decision.INCONCLUSIVE


def episodes_needed(distance: float, deviation: float, error: float) -> int | None:
    """Return the number of episodes with which a one-sided test decides (normal approximation).

    n = ((z_{1-error} + z_power) σ / distance)², the textbook formula for a mean.

    Args:
        distance: Difference between value and limit, in the value's unit.
        deviation: σ of one episode.
        error: One-sided error of the test.

    Returns:
        The number; None if the value is on the limit, where no number is enough.
    """
    from scipy.stats import norm

    if distance == 0.0:
        return None
    quantiles = float(norm.isf(error)) + float(norm.ppf(POWER))
    episodes = (quantiles * deviation / distance) ** 2
    return max(1, math.ceil(episodes)) if episodes < 1e12 else None
