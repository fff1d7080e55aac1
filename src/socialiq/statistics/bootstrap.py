"""Bootstrapped moments of paired reward vectors: made once, read at every angle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.social.angle import exact_weights
from socialiq.social.estimate import resampled


class Studentised(NamedTuple):
    """Means of one scalar for each reference, and how they vary.

    Attributes:
        mean: Of each reference.
        error: Its standard error.
        resampled: (resampled mean - mean) / resampled standard error: the bootstrap-t.
    """

    mean: Float[np.ndarray, " reference"]
    error: Float[np.ndarray, " reference"]
    resampled: Float[np.ndarray, "resample reference"]

    def of(self, rows: np.ndarray) -> Studentised:
        """Those of some references."""
        return Studentised(self.mean[rows], self.error[rows], self.resampled[:, rows])


class Moments(NamedTuple):
    """First and second moments of what references gain over a policy.

    A resample draws whole episodes, the same for all references, so what a seed makes easy or hard
    for everybody drops out, and references stay as correlated as they are.

    Attributes:
        episodes: How many.
        mean: Mean gain (env, social) of each reference.
        second: Mean squares and product of the centred gains: env², env social, social².
        resampled_mean: Of the centred gains in each resample.
        resampled_second: Likewise.
    """

    episodes: int
    mean: Float[np.ndarray, "reference 2"]
    second: Float[np.ndarray, "reference 3"]
    resampled_mean: Float[np.ndarray, "resample reference 2"]
    resampled_second: Float[np.ndarray, "resample reference 3"]

    @staticmethod
    def of(
        gains: Float[np.ndarray, "reference episode 2"], seed: int, resamples: int = 2000
    ) -> Moments:
        """Draw the resamples; memory grows with references, not with resamples times episodes.

        Args:
            gains: Of `Evidence.gains`.
            seed: Of the resampling.
            resamples: How many.
        """
        references, episodes, _ = gains.shape
        mean = gains.mean(axis=1)
        env, social = np.moveaxis(gains - mean[:, None], 2, 0)
        columns = np.stack([env, social, env**2, env * social, social**2], axis=1)
        flat = columns.reshape(-1, episodes).T
        found = [
            _counts(rows, episodes) @ flat / episodes
            for rows in resampled(episodes, resamples, seed)
        ]
        drawn = np.concatenate(found).reshape(resamples, references, 5)
        return Moments(episodes, mean, columns[:, 2:].mean(axis=2), drawn[..., :2], drawn[..., 2:])

    def at(self, angle: float) -> Studentised:
        """The scalar cos α · env + sin α · social.

        Args:
            angle: α in degrees.
        """
        env, social = exact_weights(angle)
        line = np.array([env, social])
        square = np.array([env**2, 2 * env * social, social**2])
        freedom = self.episodes - 1
        error = np.sqrt(np.maximum(self.second @ square, 0.0) / freedom)
        shift = self.resampled_mean @ line
        spread = np.maximum(self.resampled_second @ square - shift**2, 0.0)
        errors = np.sqrt(spread / freedom)
        # A resample without any spread tells nothing; `regret` bounds what is so rare otherwise.
        ratio = np.divide(shift, errors, out=np.zeros_like(shift), where=errors > 0.0)
        return Studentised(self.mean @ line, error, ratio)


def resampled_means(
    totals: Float[np.ndarray, "driver episode 2"], seed: int, resamples: int = 2000
) -> Float[np.ndarray, "resample driver 2"]:
    """Mean totals of drivers in bootstrap resamples of the episodes that they share.

    Args:
        totals: Sums of r_env and r_social.
        seed: Of the resampling.
        resamples: How many.
    """
    drivers, episodes, _ = totals.shape
    flat = np.moveaxis(totals, 1, 0).reshape(episodes, -1)
    drawn = resampled(episodes, resamples, seed)
    found = np.concatenate([_counts(rows, episodes) @ flat / episodes for rows in drawn])
    return found.reshape(resamples, drivers, 2)


def _counts(rows: np.ndarray, episodes: int) -> Float[np.ndarray, "block episodes"]:
    """How often each resample drew each episode."""
    block = len(rows)
    places = rows + episodes * np.arange(block)[:, None]
    counted = np.bincount(places.ravel(), minlength=block * episodes)
    return counted.reshape(block, episodes).astype(np.float64)
