"""Confidence intervals of shares (Wilson, Clopper and Pearson), and bounds of means of rare events.

The bounds hold for a mean whose values are nearly all equal, for which a bootstrap fails.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Num

from socialiq.errors import UserError


class Share(NamedTuple):
    """Share with the ends of its interval."""

    value: float
    low: float
    high: float


def wilson(count: int, trials: int, confidence: float = 0.95) -> Share:
    """Return a share of trials with its Wilson score interval (Wilson 1927).

    Args:
        count: Number of trials with the event.
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
    """Return a share of trials with its exact interval (Clopper & Pearson 1934).

    Each end has an error of at most (1 - confidence) / 2 for any true share. Wilson's interval is
    shorter and keeps its level on average only.

    Args:
        count: Number of trials with the event.
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


FEWEST = 20
"""Number of episodes that must differ from the common value for a bootstrap."""

_EQUAL = 1e-9  # relative to the range; below it values differ by rounding


def normal_mean(name: str, values: Num[np.ndarray, " episode"]) -> dict[str, float]:
    """Return a mean with its normal 95 % interval as columns of a row.

    Args:
        name: Name of the mean.
        values: Independent values.

    Returns:
        name, name_low and name_high; the ends are NaN for a single value.
    """
    mean = float(values.mean())
    count = len(values)
    half = 1.96 * float(values.std(ddof=1)) / count**0.5 if count > 1 else math.nan
    return {name: mean, f"{name}_low": mean - half, f"{name}_high": mean + half}


class Ratio(NamedTuple):
    """A ratio with its interval."""

    value: float
    low: float
    high: float


def variance_ratio(
    first: tuple[float, int], second: tuple[float, int], confidence: float = 0.95
) -> Ratio:
    """Return the ratio of two variances with its interval by the F distribution.

    The interval holds for normal values; heavier tails than theirs make it too narrow.

    Args:
        first: Standard deviation above the line, and its degrees of freedom.
        second: The same below the line, a deviation above 0.
        confidence: Confidence of the interval, two-sided.
    """
    from scipy.stats import f

    above, of_first = first
    below, of_second = second
    tail = (1.0 - confidence) / 2.0
    ratio = (above / below) ** 2
    low = ratio / float(f.ppf(1.0 - tail, of_first, of_second))
    return Ratio(ratio, low, ratio * float(f.ppf(1.0 - tail, of_second, of_first)))


class Bounds(NamedTuple):
    """One-sided bounds of a mean."""

    low: float
    high: float


def deviating(values: Float[np.ndarray, " episode"], reach: float) -> int:
    """Return the number of values that differ from the median, the most frequent value.

    Args:
        values: The values.
        reach: Largest absolute value that they can have.
    """
    return int((np.abs(values - np.median(values)) > _EQUAL * max(reach, 1e-300)).sum())


def seldom(values: Float[np.ndarray, " episode"], reach: float) -> bool:
    """Whether too few values differ for a bootstrap.

    If enough of the first values differ from their own median, enough of all do; this is fast.

    Args:
        values: The values.
        reach: Largest absolute value that they can have.
    """
    if deviating(values[: 4 * FEWEST], reach) >= FEWEST:
        return False
    return deviating(values, reach) < FEWEST


def bounds(
    values: Float[np.ndarray, " episode"], reach: float, low_error: float, high_error: float
) -> Bounds:
    """Bound the mean by the largest share of deviating values and their largest deviation.

    If v is the common value and a share p of all episodes deviates, the mean lies between v - p
    (reach + v) and v + p (reach - v). p has its exact binomial upper bound (Clopper & Pearson
    1934), so equal episodes throughout leave 3 reach / n at 95 %, not 0.

    Args:
        values: A difference between two drivers in each episode, for instance 0 in nearly every
            one.
        reach: Largest absolute difference: the range of all drivers' totals.
        low_error: Chance that the lower bound is above the mean.
        high_error: Chance that the upper bound is below the mean.
    """
    common = float(np.median(values))
    count = deviating(values, reach)
    below, above = (_share(count, len(values), error) for error in (low_error, high_error))
    return Bounds(common - below * (reach + common), common + above * (reach - common))


def episodes_if_rare(
    distance: float, common: float, reach: float, count: int, error: float
) -> int | None:
    """Return the number of episodes for which a bound is within a distance of the common value.

    Args:
        distance: The distance.
        common: The common value.
        reach: Largest absolute value that the values can have.
        count: Number of deviating episodes so far, which is assumed to stay the same.
        error: Error of the bound.

    Returns:
        The number; None if the distance is 0.
    """
    from scipy.stats import chi2

    if distance == 0.0:
        return None
    # The exact upper bound of a Poisson count.
    most = float(chi2.isf(error, 2 * (count + 1))) / 2
    return math.ceil(most * (reach + abs(common)) / abs(distance))


POWER = 0.9
"""Chance of a decision with the number of `episodes_needed`, if the estimate is true."""


def episodes_needed(distance: float, deviation: float, error: float) -> int | None:
    """Return the number of episodes with which a one-sided test decides (normal approximation).

    n = ((z_{1-error} + z_power) σ / distance)².

    Args:
        distance: Distance between value and limit.
        deviation: σ, the standard deviation of one episode.
        error: Error of the test.

    Returns:
        The number, at least 1. None if the distance is 0, where no number is enough, or the number
        is 1e12 or more.
    """
    from scipy.stats import norm

    if distance == 0.0:
        return None
    quantiles = float(norm.isf(error)) + float(norm.ppf(POWER))
    episodes = (quantiles * deviation / distance) ** 2
    return max(1, math.ceil(episodes)) if episodes < 1e12 else None


@cache  # an audit asks for few different ones at hundreds of angles
def _share(count: int, trials: int, error: float) -> float:
    """Return the upper bound of a share (`binomtest` gives the same by a slower search)."""
    from scipy.stats import beta

    return float(beta.isf(error, count + 1, trials - count)) if count < trials else 1.0
