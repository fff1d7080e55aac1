"""Differences between two samples, their effect size, and Holm's correction for many tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.statistics.intervals import wilson

# Differences with a smaller spread than this, relative to the data, differ by rounding only.
_EQUAL = 1e-12


def holm(p_values: Sequence[float] | Float[np.ndarray, " test"]) -> Float[np.ndarray, " test"]:
    """Adjust p-values to control the probability of any false rejection (Holm 1979).

    The k-th smallest of m is multiplied by m - k + 1; then each is at least as large as those
    before it, and at most 1.

    Raises:
        UserError: If a value is outside [0, 1].
    """
    values = np.asarray(p_values, np.float64)
    if not ((values >= 0) & (values <= 1)).all():
        raise UserError(f"p-values must lie between 0 and 1, got {values.tolist()}")
    order = np.argsort(values)
    raised = values[order] * np.arange(len(values), 0, -1)
    adjusted = np.empty_like(values)
    adjusted[order] = np.minimum(np.maximum.accumulate(raised), 1.0)
    return adjusted


class Difference(NamedTuple):
    """Mean difference with its interval and test."""

    mean: float  # mean of first - second
    low: float  # lower end
    high: float  # upper end
    p: float  # two-sided p-value of no difference


def paired_difference(
    first: Sequence[float] | Float[np.ndarray, " replicate"],
    second: Sequence[float] | Float[np.ndarray, " replicate"],
    confidence: float = 0.95,
) -> Difference:
    """Return the mean difference of two measures, by Student's paired t over replicates.

    A replicate is a training seed: the two policies trained from it are evaluated on common episode
    seeds. Episodes are not replicates: they don't show the variation of training. Where all
    differences are equal the t statistic is undefined: the interval is the point, and p is 1 if
    they are 0, else 0.

    Raises:
        UserError: If there are fewer than two pairs, unequal numbers, or a number isn't finite.
    """
    pair = [np.asarray(side, np.float64) for side in (first, second)]
    if pair[0].shape != pair[1].shape or pair[0].ndim != 1 or len(pair[0]) < 2:
        raise UserError(
            "a paired difference needs the same replicates of both, at least two, "
            f"got {pair[0].size} and {pair[1].size}"
        )
    if not np.isfinite(pair).all():
        raise UserError("a paired difference needs finite numbers: leave out what has none")
    differences = pair[0] - pair[1]
    mean = float(differences.mean())
    rounding = _EQUAL * float(np.abs(pair).max())
    if np.ptp(differences) <= rounding:
        return Difference(mean, mean, mean, float(abs(mean) <= rounding))
    from scipy.stats import t as student

    freedom = len(differences) - 1
    error = float(differences.std(ddof=1)) / math.sqrt(len(differences))
    half = float(student.ppf((1 + confidence) / 2, freedom)) * error
    p = 2 * float(student.sf(abs(mean) / error, freedom))
    return Difference(mean, mean - half, mean + half, p)


class Contrast(NamedTuple):
    """Difference of two independent samples, with an interval."""

    value: float  # first minus second
    low: float  # lower end of the interval
    high: float  # upper end


def mean_contrast(
    first: Float[np.ndarray, " n"], second: Float[np.ndarray, " m"], confidence: float = 0.95
) -> Contrast:
    """Return the difference of two means with Welch's interval (1947); variances may differ.

    Raises:
        UserError: If there are fewer than two numbers of each.
    """
    if min(len(first), len(second)) < 2:
        raise UserError("two means can't be compared on fewer than two numbers each")
    difference = float(first.mean() - second.mean())
    variances = np.array([sample.var(ddof=1) / len(sample) for sample in (first, second)])
    if variances.sum() == 0.0:
        return Contrast(difference, difference, difference)
    from scipy.stats import t as student

    freedom = variances.sum() ** 2 / (variances**2 / (len(first) - 1, len(second) - 1)).sum()
    half = float(student.ppf((1 + confidence) / 2, freedom)) * math.sqrt(variances.sum())
    return Contrast(difference, difference - half, difference + half)


def share_contrast(
    count: int, trials: int, other_count: int, other_trials: int, confidence: float = 0.95
) -> Contrast:
    """Return the difference of two shares with Newcombe's interval, from both Wilson intervals.

    It stays within [-1, 1] and has a positive width for counts of 0 (Newcombe 1998, method 10).

    Raises:
        UserError: If a sample has no trial.
    """
    first = wilson(count, trials, confidence)
    second = wilson(other_count, other_trials, confidence)
    difference = first.value - second.value
    below = math.hypot(first.value - first.low, second.high - second.value)
    above = math.hypot(first.high - first.value, second.value - second.low)
    return Contrast(difference, difference - below, difference + above)


def cohens_d(first: Float[np.ndarray, " m"], second: Float[np.ndarray, " n"]) -> float:
    """Return Cohen's d, (mean of first - mean of second) / pooled sd (thesis A.2).

    It is infinite, with the sign of the difference, where both groups are constant and differ, and
    0 where they are constant and equal.

    Raises:
        UserError: If a group has fewer than two values.
    """
    if min(len(first), len(second)) < 2:
        raise UserError("Cohen's d needs at least two values in each group")
    degrees = len(first) + len(second) - 2
    squares = (len(first) - 1) * first.var(ddof=1) + (len(second) - 1) * second.var(ddof=1)
    difference = float(first.mean() - second.mean())
    spread = math.sqrt(squares / degrees)
    if spread < 1e-12:
        return 0.0 if abs(difference) < 1e-12 else math.copysign(math.inf, difference)
    return difference / spread
