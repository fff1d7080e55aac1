"""Whether the behaviour has a direction at all: the confidence ellipse of the mean totals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Ellipse:
    """Confidence ellipse of the mean (R_env, R_social).

    Attributes:
        env: Centre, mean R_env.
        social: Centre, mean R_social.
        major: Longer half-axis, reward.
        minor: Shorter half-axis, reward.
        tilt: Of the longer axis, degrees in (-90, 90].
        confidence: Of the ellipse.
        holds_origin: If so the data don't tell one direction from its opposite, and no angle is
            reported.
    """

    env: float
    social: float
    major: float
    minor: float
    tilt: float
    confidence: float
    holds_origin: bool


def ellipse(totals: Float[np.ndarray, "episode 2"], confidence: float = 0.95) -> Ellipse:
    """Hotelling's T² region of a mean vector (Hotelling 1931).

    The mean μ is inside if n (x̄ - μ)' S⁻¹ (x̄ - μ) <= 2 (n - 1) / (n - 2) F_{2, n-2}. Where the
    totals do not vary in some direction, the region is as flat there.

    Args:
        totals: Of each episode, at least three.
        confidence: Of the region.
    """
    from scipy.stats import f

    episodes = len(totals)
    mean = totals.mean(axis=0)
    values, axes = np.linalg.eigh(np.cov(totals.T))
    limit = 2 * (episodes - 1) / (episodes - 2) * float(f.ppf(confidence, 2, episodes - 2))
    halves = np.sqrt(np.maximum(values, 0.0) * limit / episodes)
    along = np.abs(axes.T @ mean)
    # Rounding leaves a flat direction some 1e-16 of the totals' size.
    flat = halves <= 1e-12 * max(1.0, float(np.abs(totals).max()))
    ratio = np.divide(along, halves, out=np.zeros(2), where=~flat)
    apart = (flat & (along > 1e-9 * max(1.0, float(np.abs(totals).max())))).any()
    tilt = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    tilt = tilt - 180.0 if tilt > 90.0 else tilt + 180.0 if tilt <= -90.0 else tilt
    return Ellipse(
        env=float(mean[0]),
        social=float(mean[1]),
        major=float(halves[1]),
        minor=float(halves[0]),
        tilt=tilt,
        confidence=confidence,
        holds_origin=bool(not apart and (ratio**2).sum() <= 1.0),
    )
