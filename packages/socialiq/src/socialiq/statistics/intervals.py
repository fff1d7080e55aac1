"""Confidence intervals of shares: Wilson's score interval and Clopper and Pearson's exact one."""

from __future__ import annotations

from typing import NamedTuple

from socialiq.errors import UserError


class Share(NamedTuple):
    """Share with its interval.

    Attributes:
        value: The share.
        low: Lower end.
        high: Upper end.
    """

    value: float
    low: float
    high: float


def wilson(count: int, trials: int, confidence: float = 0.95) -> Share:
    """Return a share with its Wilson score interval (Wilson 1927).

    Args:
        count: Number of successes.
        trials: Number of trials.
        confidence: Confidence of the interval.

    Raises:
        UserError: If there are no trials.
    """
    _check_trials(trials)
    from scipy.stats import binomtest

    interval = binomtest(count, trials).proportion_ci(confidence, method="wilson")
    return Share(count / trials, float(interval.low), float(interval.high))


def clopper_pearson(count: int, trials: int, confidence: float = 0.95) -> Share:
    """Return a share with its exact interval (Clopper & Pearson 1934).

    Each end has an error of at most (1 - confidence) / 2 for any true share. Wilson's interval is
    shorter and keeps its level on average only.

    Args:
        count: Number of successes.
        trials: Number of trials.
        confidence: Confidence of the interval.

    Raises:
        UserError: If there are no trials.
    """
    _check_trials(trials)
    from scipy.special import betaincinv

    # Ends are quantiles of beta distributions; a root search over binomial tails finds the same.
    error = (1.0 - confidence) / 2
    low = betaincinv(count, trials - count + 1, error) if count > 0 else 0.0
    high = betaincinv(count + 1, trials - count, 1.0 - error) if count < trials else 1.0
    return Share(count / trials, float(low), float(high))


def _check_trials(trials: int) -> None:
    if trials < 1:
        raise UserError("a share needs at least one trial")
