"""Bounds of a mean whose values are nearly all equal, where no bootstrap can see the rest."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

FEWEST = 20
"""Episodes that must differ from the common value before a bootstrap may speak."""

_EQUAL = 1e-9  # relative to the range; below it values differ by rounding


class Bounds(NamedTuple):
    """One-sided bounds of a mean."""

    low: float
    high: float


def deviating(values: Float[np.ndarray, " episode"], reach: float) -> int:
    """How many values differ from the commonest one, taken to be the median.

    Args:
        values: Of a difference.
        reach: Largest absolute value that the difference can have.
    """
    return int((np.abs(values - np.median(values)) > _EQUAL * max(reach, 1e-300)).sum())


def seldom(values: Float[np.ndarray, " episode"], reach: float) -> bool:
    """Whether too few values differ for a bootstrap.

    If enough of the first ones differ from their own median, enough of all do; that is quick.

    Args:
        values: Of a difference.
        reach: As for `deviating`.
    """
    if deviating(values[: 4 * FEWEST], reach) >= FEWEST:
        return False
    return deviating(values, reach) < FEWEST


def bounds(
    values: Float[np.ndarray, " episode"], reach: float, low_error: float, high_error: float
) -> Bounds:
    """Bound the mean by how often it may deviate, and how far it could then.

    If v is the common value and a share p of all episodes deviates, the mean lies between
    v - p (reach + v) and v + p (reach - v). p has its exact binomial upper bound (Clopper &
    Pearson 1934), so equal episodes throughout leave 3 reach / n at 95 %, not 0.

    Args:
        values: A difference between two drivers, for instance 0 in nearly every episode.
        reach: Largest absolute value it can have; the range of what all drivers earned.
        low_error: Of the lower bound.
        high_error: Of the upper bound.
    """
    common, count = float(np.median(values)), deviating(values, reach)
    below, above = (_share(count, len(values), error) for error in (low_error, high_error))
    return Bounds(common - below * (reach + common), common + above * (reach - common))


def episodes_needed(
    distance: float, common: float, reach: float, count: int, error: float
) -> int | None:
    """How many episodes of the same kind leave a bound within a distance of the common value.

    Args:
        distance: From the mean to the limit.
        common: Value of nearly all episodes.
        reach: Largest absolute value.
        count: Episodes so far that deviate; the number of those to come is taken to be the same.
        error: One-sided.

    Returns:
        The number; None if the limit is the value.
    """
    from scipy.stats import chi2

    if distance == 0.0:
        return None
    # The exact upper bound of a Poisson count.
    most = float(chi2.isf(error, 2 * (count + 1))) / 2
    return math.ceil(most * (reach + abs(common)) / abs(distance))


def _share(count: int, trials: int, error: float) -> float:
    """Upper bound of a share (`binomtest` has the same, but searches for it)."""
    from scipy.stats import beta

    return float(beta.isf(error, count + 1, trials - count)) if count < trials else 1.0
