"""Intervals for what was counted."""

from __future__ import annotations

from typing import NamedTuple

from socialiq.errors import UserError


class Share(NamedTuple):
    """A share with its interval.

    Attributes:
        value: The share.
        low: Lower end.
        high: Upper end.
    """

    value: float
    low: float
    high: float


def wilson(count: int, trials: int, confidence: float = 0.95) -> Share:
    """A share with its Wilson score interval (Wilson 1927).

    Args:
        count: How often it happened.
        trials: How often it could have.
        confidence: Of the interval.

    Raises:
        UserError: If there was no trial.
    """
    if trials < 1:
        raise UserError("a share needs at least one trial")
    from scipy.stats import binomtest

    interval = binomtest(count, trials).proportion_ci(confidence, method="wilson")
    return Share(count / trials, float(interval.low), float(interval.high))
