"""Short series of pairs whose neighbours are alike: their correlation, and what a mean is worth.

Each series has a mean of its own; all share one covariance Σ and one autocorrelation ρ of the first
order, so that the pairs t and s of a series have the covariance ρ^|t - s| Σ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import softmax

CORRELATIONS = np.linspace(0.0, 0.95, 20)
"""Grid of ρ, all equally likely before the data."""

_FLAT = 1e-6  # of a typical size: smaller deviations count as none


class Serial(NamedTuple):
    """Autocorrelation and covariance of some series.

    Attributes:
        chance: Posterior of each ρ of `CORRELATIONS`.
        covariance: Σ of a single pair, at the posterior mean of ρ.
    """

    chance: Float[np.ndarray, " correlation"]
    covariance: Float[np.ndarray, "2 2"]

    @property
    def correlation(self) -> float:
        """Posterior mean of ρ."""
        return float(self.chance @ CORRELATIONS)

    def worth(self, count: int) -> float:
        """Return the number of independent pairs that a series' mean is worth.

        Args:
            count: Length of the series.
        """
        return float(self.chance @ worth_of_mean(count, CORRELATIONS))


def worth_of_mean(count: Any, correlation: Any) -> Any:
    """Return 1' R^-1 1 = (n - (n - 2) ρ) / (1 + ρ): n if ρ = 0, and 1 if ρ = 1.

    Args:
        count: Length n of a series; a number or an array.
        correlation: ρ; a number or an array.
    """
    return (count - (count - 2) * correlation) / (1 + correlation)


def mean_of(pairs: Float[np.ndarray, "row 2"], correlation: float) -> Float[np.ndarray, " 2"]:
    """Return the best linear unbiased mean: inner pairs count 1 - ρ, the first and last 1."""
    weight = np.full(len(pairs), 1.0 - correlation)
    weight[[0, -1]] = 1.0
    return weight @ pairs / weight.sum()


def fit_serial(series: Sequence[Float[np.ndarray, "_ 2"]]) -> Serial:
    """Return the autocorrelation of some series and their covariance, by restricted likelihood.

    The likelihood of differences within series (Patterson and Thompson 1971) does not take the
    series' own means for known, so that short series are not biased towards ρ < 0. Series that do
    not vary give the largest ρ: they are worth little more than one pair.

    Args:
        series: Rows of pairs; series of one row say nothing.
    """
    size = np.mean([np.square(one).mean() for one in series]) if series else 0.0
    flat = (_FLAT**2) * (1.0 + size) * np.eye(2)
    freedom = sum(len(one) - 1 for one in series)
    sums = [_within(series, rho) + flat for rho in CORRELATIONS]
    log_p = np.array(
        [
            _log_restricted(series, rho, total, freedom)
            for rho, total in zip(CORRELATIONS, sums, strict=True)
        ]
    )
    chance = softmax(log_p)
    nearest = int(np.abs(CORRELATIONS - chance @ CORRELATIONS).argmin())
    return Serial(chance, sums[nearest] / max(freedom, 1))


def _within(series: Sequence[Float[np.ndarray, "_ 2"]], rho: float) -> Float[np.ndarray, "2 2"]:
    """Return Σ over the series of (x - m)' R^-1 (x - m)."""
    total = np.zeros((2, 2))
    for one in series:
        off = one - mean_of(one, rho)
        step = off[1:] - rho * off[:-1]
        total += np.outer(off[0], off[0]) + step.T @ step / (1 - rho**2)
    return total


def _log_restricted(
    series: Sequence[Float[np.ndarray, "_ 2"]],
    rho: float,
    within: Float[np.ndarray, "2 2"],
    freedom: int,
) -> float:
    if freedom == 0:
        return 0.0
    count = np.array([len(one) for one in series])
    of_design = ((count - 1) * np.log(1 - rho**2) + np.log(worth_of_mean(count, rho))).sum()
    return float(-of_design - 0.5 * freedom * np.linalg.slogdet(within / freedom)[1])
