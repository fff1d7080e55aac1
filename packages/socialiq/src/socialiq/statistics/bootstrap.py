"""Bootstrap over episodes: resampled moments, and bootstrap-t bounds of the largest mean."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64

_BLOCK = 1_000_000  # rows drawn at once: 8 MB, and 16 MB of the totals that they pick

_KEPT = 4_000_000  # counts kept for the next call, 32 MB: an audit draws the same for each driver


def resample_rows(
    episodes: int, resamples: int, seed: int
) -> Iterator[Int64[np.ndarray, "block episodes"]]:
    """Draw the rows of bootstrap resamples in blocks, with memory independent of their number.

    Args:
        episodes: Number of episodes, and of rows in each resample.
        resamples: Number of resamples.
        seed: Seed of the draw.

    Yields:
        Blocks of rows. Together they are a draw of shape (resamples, episodes) for any block size.
    """
    rng = np.random.default_rng(seed)
    block = max(1, _BLOCK // episodes)
    for first in range(0, resamples, block):
        yield rng.integers(episodes, size=(min(block, resamples - first), episodes))


class Studentised(NamedTuple):
    """Means of a scalar for each reference, with standard errors and resamples."""

    mean: Float[np.ndarray, " reference"]  # mean of each reference
    error: Float[np.ndarray, " reference"]  # standard error of each mean
    # (resampled mean - mean) / resampled standard error: the bootstrap-t
    resampled: Float[np.ndarray, "resample reference"]

    def of(self, rows: np.ndarray) -> Studentised:
        """Return the means of some references."""
        return Studentised(self.mean[rows], self.error[rows], self.resampled[:, rows])


class Moments(NamedTuple):
    """First and second moments of the gains of references over a policy.

    A resample draws whole episodes, the same for all references, so the common effect of a seed
    cancels, and the correlation of references is preserved.
    """

    episodes: int  # number of episodes
    mean: Float[np.ndarray, "reference 2"]  # mean gain (env, social) of each reference
    # mean squares and product of the centred gains: env², env social, social²
    second: Float[np.ndarray, "reference 3"]
    # mean of the centred gains in each resample
    resampled_mean: Float[np.ndarray, "resample reference 2"]
    # second moments of the centred gains in each resample
    resampled_second: Float[np.ndarray, "resample reference 3"]

    @staticmethod
    def of(
        gains: Float[np.ndarray, "reference episode 2"], seed: int, resamples: int = 2000
    ) -> Moments:
        """Draw the resamples; memory grows with references, not with resamples times episodes.

        Args:
            gains: Gain (env, social) of each reference over the policy in each episode.
            seed: Seed of the bootstrap.
            resamples: Number of resamples.
        """
        references, episodes, _ = gains.shape
        mean = gains.mean(axis=1)
        env, social = np.moveaxis(gains - mean[:, None], 2, 0)
        columns = np.stack([env, social, env**2, env * social, social**2], axis=1)
        flat = columns.reshape(-1, episodes).T
        means = [counts @ flat / episodes for counts in _drawn(episodes, resamples, seed)]
        resampled = np.concatenate(means).reshape(resamples, references, 5)
        return Moments(
            episodes, mean, columns[:, 2:].mean(axis=2), resampled[..., :2], resampled[..., 2:]
        )

    def at(self, weights: tuple[float, float], rows: np.ndarray) -> Studentised:
        """Return the weighted sum of both gains of some references, as one scalar.

        Args:
            weights: (cos α, sin α), as in R(α).
            rows: Indices of the references.
        """
        env, social = weights
        freedom = self.episodes - 1
        error = np.sqrt(np.maximum(_variance(self.second[rows], env, social), 0.0) / freedom)
        shift = _mean(self.resampled_mean[:, rows], env, social)
        spread = np.maximum(_variance(self.resampled_second[:, rows], env, social) - shift**2, 0.0)
        errors = np.sqrt(spread / freedom)
        # A resample without spread has no information; `regret` bounds such rare events otherwise.
        ratio = np.divide(shift, errors, out=np.zeros_like(shift), where=errors > 0.0)
        return Studentised(_mean(self.mean[rows], env, social), error, ratio)


def _mean(gains: Float[np.ndarray, "*shape 2"], env: float, social: float) -> np.ndarray:
    """Return the mean of the weighted sum."""
    return env * gains[..., 0] + social * gains[..., 1]


def _variance(moments: Float[np.ndarray, "*shape 3"], env: float, social: float) -> np.ndarray:
    """Return the mean square of the weighted sum of the centred gains."""
    of_env, product, of_social = np.moveaxis(moments, -1, 0)
    return env**2 * of_env + 2 * env * social * product + social**2 * of_social


def resampled_means(
    totals: Float[np.ndarray, "driver episode 2"], seed: int, resamples: int = 2000
) -> Float[np.ndarray, "resample driver 2"]:
    """Return mean totals of drivers in bootstrap resamples of their common episodes.

    Args:
        totals: Sums of (r_env, r_social) of each driver in each episode.
        seed: Seed of the bootstrap.
        resamples: Number of resamples.
    """
    drivers, episodes, _ = totals.shape
    flat = np.moveaxis(totals, 1, 0).reshape(episodes, -1)
    counts = _drawn(episodes, resamples, seed)
    means = np.concatenate([block @ flat / episodes for block in counts])
    return means.reshape(resamples, drivers, 2)


def _drawn(episodes: int, resamples: int, seed: int) -> Iterable[np.ndarray]:
    """Return in blocks how often each resample drew each episode."""
    if episodes * resamples <= _KEPT:
        return _kept(episodes, resamples, seed)
    return (_counts(rows, episodes) for rows in resample_rows(episodes, resamples, seed))


@lru_cache(maxsize=1)
def _kept(episodes: int, resamples: int, seed: int) -> tuple[np.ndarray, ...]:
    rows = resample_rows(episodes, resamples, seed)
    return tuple(_counts(block, episodes) for block in rows)


def _counts(rows: np.ndarray, episodes: int) -> Float[np.ndarray, "block episodes"]:
    """Return how often each resample drew each episode."""
    block = len(rows)
    places = rows + episodes * np.arange(block)[:, None]
    counted = np.bincount(places.ravel(), minlength=block * episodes)
    return counted.reshape(block, episodes).astype(np.float64)


_FIRST_STEP = 0.1  # share of the error for the selection of references that can matter

_HALVINGS = 40


def upper_bounds(means: Studentised, error: float) -> Float[np.ndarray, " reference"]:
    """Return a one-sided upper bound of each mean by bootstrap-t.

    Their maximum bounds the largest mean at the same error, whatever the number of references
    and without a correction: that largest mean is one of these means, so it exceeds the maximum
    only if it exceeds its own bound. As a test of "every reference is within the margin" it is an
    intersection-union test (Berger 1982), which is exact where one reference is clearly the best
    and conservative where several tie.

    Args:
        means: The means with their resamples.
        error: Chance that a bound is below its mean.
    """
    low = np.quantile(means.resampled, error, axis=0)
    return means.mean - low * means.error


def largest_exceeds(means: Studentised, limit: float, error: float) -> bool:
    """Whether the largest mean is significantly above a limit.

    Here one reference is enough, and the apparently best reference was selected by the data, so the
    error must be divided. Bonferroni would divide it by the number of references, though most are
    correlated and many far below the limit. Instead the critical value is the quantile of the
    largest of the bootstrapped t, in which each reference is lowered by how far its own mean must
    be below the limit (Romano, Shaikh & Wolf 2014, two-step method; a tenth of the error goes to
    that first step). With one reference it is Student's one-sided test, which needs no first step.

    Args:
        means: The means with their resamples; all standard errors must be positive.
        limit: The limit.
        error: Error of the test.
    """
    # Simultaneous upper bounds of the means, at a tenth of the error.
    smallest = means.resampled.min(axis=1)
    highest = means.mean - float(np.quantile(smallest, _FIRST_STEP * error)) * means.error
    first = 0.0 if len(means.mean) == 1 else _FIRST_STEP
    if (highest < limit).all():
        return False
    lowered = np.minimum(highest - limit, 0.0) / means.error if first else np.zeros(1)
    largest = (means.resampled + lowered).max(axis=1)
    critical = max(0.0, float(np.quantile(largest, 1.0 - (1.0 - first) * error)))
    return bool(((means.mean - limit) / means.error).max() > critical)


def largest_lower_bound(means: Studentised, error: float) -> float:
    """Return a one-sided lower bound of the largest mean, by bisection of `largest_exceeds`.

    Args:
        means: The means with their resamples; all standard errors must be positive.
        error: Chance that the bound is above the largest mean.
    """
    high = float(means.mean.max())
    low = high - 50.0 * float(means.error.max())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if largest_exceeds(means, middle, error) else (low, middle)
    return low
