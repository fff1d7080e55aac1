"""Posteriors of the directions of drivers' mean reward pairs, and their mixture by sector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

SECTOR = 15.0
"""Degrees; width of the sectors of posteriors."""


class Sector(NamedTuple):
    """Posterior probability of a sector of directions.

    Attributes:
        low: Degrees, from -180.
        high: Degrees, up to 180.
        share: Mean over the drivers.
        share_moving: Mean over the moving drivers; NaN if none moves.
    """

    low: float
    high: float
    share: float
    share_moving: float


def sectors(
    drivers: Sequence[tuple[Float64[np.ndarray, "_ 2"], bool]], seed: int, draws: int
) -> tuple[Sector, ...]:
    """Return the mixture of all drivers' posteriors by sector, each driver counted once.

    Args:
        drivers: Reward pairs of each driver's decisions, at least three, and whether it moves.
        seed: Of the draws.
        draws: Number of draws from each posterior.

    Returns:
        Sectors from -180 to 180 degrees; empty without drivers.
    """
    if not drivers:
        return ()
    rng, ends = np.random.default_rng(seed), np.arange(-180.0, 180.0 + SECTOR, SECTOR)
    shares = np.array(
        [np.histogram(posterior(pairs, draws, rng), ends)[0] / draws for pairs, _ in drivers]
    )
    moving = np.array([moves for _, moves in drivers])
    of_moving = shares[moving].mean(axis=0) if moving.any() else np.full(len(ends) - 1, np.nan)
    rows = zip(ends[:-1], ends[1:], shares.mean(axis=0), of_moving, strict=True)
    return tuple(Sector(*map(float, row)) for row in rows)


def posterior(
    pairs: Float64[np.ndarray, "decision 2"], draws: int, rng: np.random.Generator
) -> Float64[np.ndarray, " draw"]:
    """Return directions of draws from the posterior of the mean pair, in [-180, 180] degrees.

    For independent normal rows and the prior `|Σ|^(-3/2)` the mean is t-distributed around x̄ with
    n - 2 degrees of freedom and scale S / (n (n - 2)), S the sum of squares (Geisser & Cornfield
    1963). Its regions of highest density are Hotelling's, as in `social.angle.direction_interval`.

    Args:
        pairs: r_env and r_social, at least three rows.
        draws: Number of draws.
        rng: Generator of the draws.
    """
    count, free = len(pairs), len(pairs) - 2
    values, axes = np.linalg.eigh(np.cov(pairs.T) * (count - 1) / (count * free))
    normal = (rng.standard_normal((draws, 2)) * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    tails = np.sqrt(free / rng.chisquare(free, draws))
    drawn = pairs.mean(axis=0) + normal * tails[:, None]
    return np.degrees(np.arctan2(drawn[:, 1], drawn[:, 0]))
