"""Which directions a mean reward pair may have: those of its confidence ellipse."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from socialiq.social.angle import angle_of

_AROUND = 3600  # points of the ellipse that are looked at


class Directions(NamedTuple):
    """Ends of the directions in degrees, unwrapped around that of the mean."""

    low: float
    high: float


def directions(pairs: Float64[np.ndarray, "row 2"], confidence: float) -> Directions | None:
    """The directions seen from the origin of Hotelling's T² region of the mean.

    The mean μ is inside if n (x̄ - μ)' S⁻¹ (x̄ - μ) <= 2 (n - 1) / (n - 2) F_{2, n-2} (Hotelling
    1931), if rows are independent. The region is of the whole vector, so the directions are
    covered at least as often as it is.

    Args:
        pairs: r_env and r_social, at least three rows.
        confidence: Of the region.

    Returns:
        None if the origin is inside: then no direction is excluded.
    """
    from scipy.stats import f

    count, mean = len(pairs), pairs.mean(axis=0)
    limit = 2 * (count - 1) / (count - 2) * float(f.ppf(confidence, 2, count - 2))
    values, axes = np.linalg.eigh(np.cov(pairs.T))
    halves = np.sqrt(np.maximum(values, 0.0) * limit / count)
    size = max(1.0, float(abs(pairs).max()))
    seen = axes.T @ mean
    # Rounding leaves a flat direction some 1e-16 of the rewards' size.
    flat = halves <= 1e-12 * size
    ratio = np.divide(abs(seen), halves, out=np.zeros(2), where=~flat)
    apart = bool((flat & (abs(seen) > 1e-9 * size)).any())
    if not apart and (ratio**2).sum() <= 1.0:
        return None
    turn = np.linspace(0.0, 2 * np.pi, _AROUND, endpoint=False)
    edge = mean + (np.stack([np.cos(turn), np.sin(turn)], axis=1) * halves) @ axes.T
    angle = angle_of(*mean.tolist())
    off = np.degrees(np.arctan2(edge[:, 1], edge[:, 0])) - angle
    wrapped = (off + 180.0) % 360.0 - 180.0
    return Directions(angle + float(wrapped.min()), angle + float(wrapped.max()))


SECTOR = 15.0
"""Degrees; width of the sectors in which posteriors are told."""


class Sector(NamedTuple):
    """How much of the drivers' posteriors lies in one sector of directions.

    Attributes:
        low: Degrees, from -180.
        high: Degrees, up to 180.
        share: Mean over the drivers.
        share_moving: Mean over those of them who move; NaN if nobody does.
    """

    low: float
    high: float
    share: float
    share_moving: float


def sectors(
    drivers: Sequence[tuple[Float64[np.ndarray, "_ 2"], bool]], seed: int, draws: int
) -> tuple[Sector, ...]:
    """The mixture of all drivers' posteriors, each driver counted once.

    Args:
        drivers: Reward pairs of each driver's decisions, at least three, and whether it moves.
        seed: Of the draws.
        draws: From each posterior.

    Returns:
        Sectors from -180 to 180 degrees; none without drivers.
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
    """Directions of draws from the posterior of the mean pair, in [-180, 180] degrees.

    For independent normal rows and the prior `|Σ|^(-3/2)` the mean is t-distributed around x̄ with
    n - 2 degrees of freedom and scale S / (n (n - 2)), S the sum of squares (Geisser & Cornfield
    1963). Its regions of highest density are Hotelling's, those of `directions`.

    Args:
        pairs: r_env and r_social, at least three rows.
        draws: How many.
        rng: Source of the draws.
    """
    count, free = len(pairs), len(pairs) - 2
    values, axes = np.linalg.eigh(np.cov(pairs.T) * (count - 1) / (count * free))
    normal = (rng.standard_normal((draws, 2)) * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    tails = np.sqrt(free / rng.chisquare(free, draws))
    drawn = pairs.mean(axis=0) + normal * tails[:, None]
    return np.degrees(np.arctan2(drawn[:, 1], drawn[:, 0]))
