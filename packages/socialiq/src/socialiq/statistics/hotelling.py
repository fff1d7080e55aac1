"""Hotelling's T-squared confidence region of the mean of pairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Region(NamedTuple):
    """Confidence region of a mean pair: an ellipse in its principal axes."""

    mean: Float[np.ndarray, " 2"]  # centre
    halves: Float[np.ndarray, " 2"]  # half-axes, the shorter one first
    axes: Float[np.ndarray, "2 2"]  # unit vectors of the axes, one in each column
    holds_origin: bool  # whether (0, 0) is inside


def hotelling_region(pairs: Float[np.ndarray, "row 2"], confidence: float) -> Region:
    """Return Hotelling's T² region of a mean vector (Hotelling 1931), for independent rows.

    The mean μ is inside if n (x̄ - μ)' S⁻¹ (x̄ - μ) <= 2 (n - 1) / (n - 2) F_{2, n-2}. Where the
    rows do not vary in some direction, the region has no extent in it.

    Args:
        pairs: At least three rows.
        confidence: Confidence of the region.
    """
    from scipy.stats import f

    count = len(pairs)
    mean = pairs.mean(axis=0)
    values, axes = np.linalg.eigh(np.cov(pairs.T))
    limit = 2 * (count - 1) / (count - 2) * float(f.ppf(confidence, 2, count - 2))
    halves = np.sqrt(np.maximum(values, 0.0) * limit / count)
    along = np.abs(axes.T @ mean)
    size = max(1.0, float(np.abs(pairs).max()))
    # Rounding gives a flat direction about 1e-16 of the rows' size.
    flat = halves <= 1e-12 * size
    ratio = np.divide(along, halves, out=np.zeros(2), where=~flat)
    apart = (flat & (along > 1e-9 * size)).any()
    return Region(mean, halves, axes, bool(not apart and (ratio**2).sum() <= 1.0))


@dataclass(frozen=True)
class Ellipse:
    """Confidence ellipse of the mean (R_env, R_social)."""

    env: float  # centre, mean R_env
    social: float  # centre, mean R_social
    major: float  # longer half-axis, reward
    minor: float  # shorter half-axis, reward
    tilt: float  # direction of the longer axis, degrees in (-90, 90]
    confidence: float  # confidence of the ellipse
    # whether (0, 0) is inside: then no direction is excluded, and no angle is reported
    holds_origin: bool


def confidence_ellipse(totals: Float[np.ndarray, "episode 2"], confidence: float = 0.95) -> Ellipse:
    """Return the confidence region of mean totals: its centre, half-axes and tilt.

    Args:
        totals: Sums of (r_env, r_social) of at least three episodes.
        confidence: Confidence of the region.
    """
    region = hotelling_region(totals, confidence)
    first, second = region.axes[:, 1]
    tilt = float(np.degrees(np.arctan2(second, first)))
    tilt = tilt - 180.0 if tilt > 90.0 else tilt + 180.0 if tilt <= -90.0 else tilt
    return Ellipse(
        env=float(region.mean[0]),
        social=float(region.mean[1]),
        major=float(region.halves[1]),
        minor=float(region.halves[0]),
        tilt=tilt,
        confidence=confidence,
        holds_origin=region.holds_origin,
    )
