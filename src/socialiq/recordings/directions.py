"""Which directions a mean reward pair may have: those of its confidence ellipse."""

from __future__ import annotations

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
