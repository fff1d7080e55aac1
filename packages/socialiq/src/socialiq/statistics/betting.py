"""Bounds of a mean that hold for every distribution below a known limit, by betting.

A bettor who may stake on "the next value is below m" can't expect to gain if the mean is m or
more. By Ville's inequality the wealth, which starts at 1, then reaches 1 / error with a chance of
at most `error`, whatever the distribution and whatever the stakes, as long as each stake depends
on earlier values only (Waudby-Smith and Ramdas 2024, "Estimating means of bounded random variables
by betting", J. R. Stat. Soc. B 86). So an m at which the wealth gets there is rejected.

The stakes decide only how many values are needed. They aim at 1 / error at the last value: each is
recalculated from the wealth so far and the number of values left (Voracek and Orabona 2025,
"STaR-Bets: sequential target-recalculating bets for tighter confidence intervals").
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int64

Series = Float[np.ndarray, "series episode"]
Levels = Float[np.ndarray, " level"]

LARGEST_STAKE = 0.9
"""Largest share of the wealth at stake. With 1, a single value on the limit would ruin it."""

_FIRST_DEVIATION = 0.1  # of the limit: stands for the deviation before there are values
_STEP = 0.1  # of `levels`: neighbours far from the margin differ by a tenth of their distance
_FINEST = 0.05  # of the margin; levels close to it are a tenth of this apart


def levels(margin: float, limit: float, between: bool = False) -> Levels:
    """Return candidates of a mean, dense around a margin, chosen before there are values.

    A bound is one of them. Its guarantee needs no finer grid: a mean that lies between two levels
    is at least the lower one, so the test of that level covers it.

    Args:
        margin: The margin, positive.
        limit: Largest absolute value of a level, which no level reaches.
        between: Whether the margin lies midway between two levels: for a lower bound, which must be
            above the margin, not on it.

    Returns:
        Levels in rising order.
    """
    finest = _FINEST * margin
    steps = math.ceil(math.asinh((limit + margin) / finest) / _STEP)
    places = np.arange(-steps, steps + 1) + (0.5 if between else 0.0)
    grid = margin + finest * np.sinh(_STEP * places)
    return grid[(grid > -limit) & (grid < limit)]


def significantly_below(
    values: Series, means: Levels, limit: float, error: float | Levels
) -> Bool[np.ndarray, "series level"]:
    """Test for each series and level whether the mean is below the level.

    Args:
        values: Independent values in the order of their drawing. Each is at most the limit, and may
            be arbitrarily low.
        means: The levels.
        limit: Largest value, positive and above every level.
        error: Largest chance, at each level, that the test says so of a mean that is not below; one
            number, or one for each level.
    """
    episodes = values.shape[1]
    count = np.arange(1.0, episodes + 1.0)
    columns = values.T
    # Mean and deviation of the values before each one.
    mean = np.cumsum(columns, axis=0) / count[:, None]
    before = np.concatenate([np.zeros((1, len(values))), mean[:-1]])
    squares = np.cumsum((columns - before) * (columns - mean), axis=0)
    spread = (_FIRST_DEVIATION * limit) ** 2 + np.concatenate([before[:1], squares[:-1]])
    scale = np.sqrt(2.0 / (episodes - count + 1.0) * count / spread.T).T[:, :, None]
    # The logarithm of error times wealth: the target is 0.
    wealth = np.log(np.broadcast_to(error, (len(values), len(means))))
    most = LARGEST_STAKE / (limit - means)
    for column, factor in zip(columns[:, :, None], scale, strict=True):
        # Once the target is reached, nothing is staked and the wealth stays.
        stake = np.minimum(np.sqrt(np.maximum(-wealth, 0.0)) * factor, most)
        wealth += np.log1p(stake * (means - column))
    return wealth >= 0.0


def bounds_by_betting(
    values: Series, means: Levels, limit: float, error: float
) -> Float[np.ndarray, " series"]:
    """Return a one-sided upper bound of each mean, for any distribution up to the limit.

    It is the lowest level from which on all levels are rejected. If it is below the true mean, the
    highest level up to that mean was rejected wrongly: the bound has that one test's error.

    Args:
        values: Independent values in the order of their drawing.
        means: The levels, rising and chosen without the values.
        limit: Largest value, positive and above every level.
        error: Largest chance that a bound is below its mean.

    Returns:
        A level or the limit; infinity for a series with a value above the limit.
    """
    allowed = (values <= limit).all(axis=1)
    bounds = np.full(len(values), np.inf)
    below = significantly_below(values[allowed], means, limit, error)
    rejected = np.logical_and.accumulate(below[:, ::-1], axis=1).sum(axis=1)
    bounds[allowed] = np.append(means, limit)[len(means) - rejected]
    return bounds


def lower_bound_of_largest(values: Series, means: Levels, limit: float, error: float) -> float:
    """Return a one-sided lower bound of the largest mean, for any distribution.

    Each stake is on the series that was largest so far. If every mean is at most m, none of these
    stakes can expect to gain, so the choice of the series needs no correction.

    Args:
        values: Series of the same episodes, in the order of their drawing.
        means: Levels, rising, each above -limit, and chosen without the values.
        limit: Positive number; the values are at least -limit.
        error: Largest chance that the bound is above the largest mean.

    Returns:
        The bound; minus infinity if a value that is staked on is below -limit.
    """
    followed = values[leading(values), np.arange(values.shape[1])][None]
    return -float(bounds_by_betting(-followed, -means[::-1], limit, error)[0])


def leading(values: Series) -> Int64[np.ndarray, " episode"]:
    """Return before each episode the series with the largest mean so far, at first the first."""
    totals = np.cumsum(values, axis=1)[:, :-1]
    return np.append(0, totals.argmax(axis=0)).astype(np.int64)


def episodes_by_betting(
    values: Float[np.ndarray, " episode"], mean: float, limit: float, error: float, power: float
) -> int | None:
    """Return the number of values with which a mean is found to be below a level.

    The logarithm of the wealth is a sum of independent terms, taken as normal, with one constant
    stake: the best of those allowed for the values at hand.

    Args:
        values: Typical values.
        mean: The level.
        limit: Largest value, above the level.
        error: Error of the test.
        power: Chance of a decision if the values are typical.

    Returns:
        The number, at least 1. None if no stake gains on the values, or one is above the limit.
    """
    from scipy.stats import norm

    if values.max() > limit:
        return None
    target = -math.log(error)
    quantile = float(norm.ppf(power))
    stakes = LARGEST_STAKE / (limit - mean) * np.geomspace(1e-4, 1.0, 60)
    gained = np.log1p(stakes[:, None] * (mean - values))
    drift = gained.mean(axis=1)
    deviation = gained.std(axis=1)
    if not (drift > 0.0).any():
        return None
    deviation = deviation[drift > 0.0]
    drift = drift[drift > 0.0]
    spread = quantile * deviation
    root = (spread + np.sqrt(spread**2 + 4.0 * drift * target)) / (2.0 * drift)
    return max(1, math.ceil(float(np.min(root) ** 2)))
