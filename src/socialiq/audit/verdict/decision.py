"""Pass, fail or inconclusive, and how many episodes would decide."""

from __future__ import annotations

import enum
import math

POWER = 0.9
"""Chance of a decision with as many episodes as `episodes_needed` says, if the estimate is true."""


class Decision(enum.Enum):
    """The outcome of a test, and of the whole audit."""

    PASS = "pass"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"


def decide(low: float, high: float, limit: float) -> Decision:
    """Compare an interval with the largest value allowed.

    Args:
        low: One-sided lower bound.
        high: One-sided upper bound.
        limit: The largest value that passes.
    """
    if high <= limit:
        return Decision.PASS
    return Decision.FAIL if low > limit else Decision.INCONCLUSIVE


def episodes_needed(distance: float, deviation: float, error: float) -> int | None:
    """Number of episodes that a one-sided test needs to decide, by the normal approximation.

    n = ((z_{1-error} + z_power) σ / distance)², the textbook formula for a mean.

    Args:
        distance: Between the value and the limit, in the value's unit.
        deviation: σ of one episode.
        error: Of the test, one-sided.

    Returns:
        The number; None if the value lies on the limit, where none is enough.
    """
    from scipy.stats import norm

    if distance == 0.0:
        return None
    quantiles = float(norm.isf(error)) + float(norm.ppf(POWER))
    episodes = (quantiles * deviation / distance) ** 2
    return max(1, math.ceil(episodes)) if episodes < 1e12 else None
