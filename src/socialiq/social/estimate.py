"""α̂ with a bootstrap interval of the vector (R_env, R_social), never of degrees (thesis 5.4)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64

from socialiq.errors import UserError
from socialiq.social.angle import angle_of

_BLOCK = 1_000_000  # rows drawn at once: 8 MB, and 16 MB of the totals that they pick


class AngleEstimate(NamedTuple):
    """An empirical angle and its percentile interval, in degrees.

    `low` and `high` are `angle` plus wrapped deviations, so they may leave (-180, 180].
    """

    angle: float
    low: float
    high: float
    env: float
    social: float


def estimate_angle(
    env: Float[np.ndarray, " episodes"],
    social: Float[np.ndarray, " episodes"],
    seed: int,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> AngleEstimate:
    """Estimate α̂ from episode totals, with a seeded percentile bootstrap over episodes.

    Each resample draws whole episodes, so the pair stays together; its mean vector gives an
    angle, whose deviation from α̂ is wrapped before the percentiles are taken.

    Args:
        env: Sum of r_env of each episode.
        social: Sum of r_social of each episode.
        seed: Of the resampling.
        confidence: Level of the two-sided interval.
        resamples: Number of bootstrap resamples.

    Raises:
        UserError: If there are no episodes or a total is not finite.
    """
    totals = np.stack([env, social], axis=1).astype(np.float64)
    if len(totals) == 0 or not np.isfinite(totals).all():
        raise UserError("an angle needs at least one episode, and finite reward totals")
    mean_env, mean_social = totals.mean(axis=0)
    angle = angle_of(mean_env, mean_social)
    drawn = resampled(len(totals), resamples, seed)
    means = np.concatenate([totals[rows].mean(axis=1) for rows in drawn])
    deviations = np.degrees(np.arctan2(means[:, 1], means[:, 0])) - angle
    wrapped = (deviations + 180.0) % 360.0 - 180.0
    low, high = angle + np.quantile(wrapped, [(1 - confidence) / 2, (1 + confidence) / 2])
    return AngleEstimate(angle, float(low), float(high), float(mean_env), float(mean_social))


def resampled(
    episodes: int, resamples: int, seed: int
) -> Iterator[Int64[np.ndarray, "block episodes"]]:
    """Draw the rows of bootstrap resamples, block by block: memory doesn't grow with their number.

    Put together the blocks are one draw of shape (resamples, episodes), wherever they are cut.

    Args:
        episodes: How many rows a resample draws, and from how many.
        resamples: How many resamples.
        seed: Of the draws.
    """
    rng = np.random.default_rng(seed)
    block = max(1, _BLOCK // episodes)
    for first in range(0, resamples, block):
        yield rng.integers(episodes, size=(min(block, resamples - first), episodes))
