"""Mean differences of decisions that are independent by cluster only: bootstrap and sign flips."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64

from socialiq.errors import UserError
from socialiq.statistics.bootstrap import resample_rows

EXACT = 14
"""Most clusters of which every pattern of signs is counted; above, patterns are drawn."""


class ClusterMean(NamedTuple):
    """Mean over all rows, with an interval by cluster."""

    mean: float  # mean over rows
    low: float  # lower end of the percentile interval; NaN with fewer than two clusters
    high: float  # upper end
    clusters: int  # number of clusters


def cluster_mean(
    values: Float[np.ndarray, " row"],
    cluster: Int64[np.ndarray, " row"],
    seed: int,
    resamples: int = 2000,
    confidence: float = 0.95,
) -> ClusterMean:
    """Return the mean of paired differences, with an interval from resampled clusters of rows.

    Rows of one cluster may depend on each other in any way (Cameron, Gelbach and Miller 2008).

    Raises:
        UserError: If there is no row.
    """
    if len(values) == 0:
        raise UserError("a mean by cluster needs at least one row")
    number = np.unique(cluster, return_inverse=True)[1]
    sums, sizes = np.bincount(number, values), np.bincount(number).astype(np.float64)
    low = high = math.nan
    if len(sums) > 1:
        sample = resample_rows(len(sums), resamples, seed)
        means = [sums[rows].sum(axis=1) / sizes[rows].sum(axis=1) for rows in sample]
        low, high = np.quantile(
            np.concatenate(means), [(1 - confidence) / 2, (1 + confidence) / 2]
        ).tolist()
    return ClusterMean(float(values.mean()), low, high, len(sums))


def _signs(count: int, seed: int, draws: int) -> Float[np.ndarray, "pattern cluster"]:
    if count <= EXACT:
        return 1.0 - 2.0 * ((np.arange(2**count)[:, None] >> np.arange(count)) & 1)
    bits = np.random.default_rng(seed).integers(0, 2, (draws, count))
    return np.vstack([np.ones(count), 1.0 - 2.0 * bits])


class SignFlips(NamedTuple):
    """Two-sided p-values of several sign-flip tests."""

    p: Float[np.ndarray, " test"]  # of each test by itself
    corrected: Float[np.ndarray, " test"]  # of each test, for the family of all


def sign_flips(sums: Float[np.ndarray, "test cluster"], seed: int, draws: int = 2000) -> SignFlips:
    """Return p-values of several sign-flip tests (Fisher 1935) on common clusters.

    Under the hypothesis a cluster's sum is as likely as its negative. All patterns of signs are
    counted up to `EXACT` clusters, otherwise drawn, with that of the data among them. For the
    corrected p-values every pattern is applied to all tests at once, and `|Σ sums| / sqrt(Σ sums²)`
    is compared with the largest over the tests: the step-down procedure of Westfall and Young
    (1993, algorithm 2.8). It controls the probability of any false rejection, as Holm's does, but
    tests that depend on each other cost less, and the smallest p-value doesn't rise with their
    number. A sum is 0 where a test has no row of a cluster.
    """
    scale = np.sqrt((sums**2).sum(axis=1, keepdims=True))
    unit = np.divide(sums, scale, out=np.zeros_like(sums), where=scale > 0)
    reached = np.abs(_signs(sums.shape[1], seed, draws) @ unit.T)  # patterns, tests
    observed = np.abs(unit.sum(axis=1)) * (1 - 1e-9)
    order = np.argsort(-observed, kind="stable")
    largest = np.maximum.accumulate(reached[:, order[::-1]], axis=1)[:, ::-1]
    adjusted = np.maximum.accumulate((largest >= observed[order]).mean(axis=0))
    corrected = np.empty(len(sums))
    corrected[order] = adjusted
    return SignFlips((reached >= observed).mean(axis=0), corrected)


def least_p(clusters: int) -> float:
    """Return the smallest p-value of the two-sided sign-flip test, 2^(1 - n)."""
    return min(1.0, 2.0 ** (1 - clusters))


def clusters_needed(error: float) -> int:
    """Return the fewest clusters whose `least_p` is at most `error`."""
    return max(1, math.ceil(1 - math.log2(error)))
