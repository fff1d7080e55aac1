"""Bounds of a mean whose values are nearly all equal, where no bootstrap can see the rest."""

from __future__ import annotations

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


def _share(count: int, trials: int, error: float) -> float:
    """Upper bound of a share."""
    from scipy.stats import binomtest

    return float(binomtest(count, trials, alternative="less").proportion_ci(1.0 - error).high)
