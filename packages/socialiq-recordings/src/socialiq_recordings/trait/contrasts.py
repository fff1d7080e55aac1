"""Differences between models of the same decisions, by independent chain, all of them corrected."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from socialiq.statistics.clusters import cluster_mean, clusters_needed
from socialiq.statistics.comparisons import holm
from socialiq.types import Row
from socialiq_recordings.trait.choice_model import Prediction
from socialiq_recordings.trait.models import Models

RIVALS = ("population", "progress gain", "last residual", "running residual", "shuffled angle")
"""Models that the angle must be better than, and what it would show: that drivers differ, in what
they do about others, for longer than a moment, and each in its own way."""

ERROR = 0.05
"""Chance that any contrast is called a gain though none is."""


def scores(models: Models) -> list[Row]:
    """Return the mean log-likelihood and the error of every model, by model."""
    observed = models.sample.table.acceleration[models.sample.second]
    base = models.predictions["base"]
    return [
        {
            "model": name,
            "decisions": len(observed),
            "log_likelihood": float(one.log_likelihood.mean()),
            "gain_nats": float((one.log_likelihood - base.log_likelihood).mean()),
            "rmse": float(np.sqrt(np.mean((observed - one.mean) ** 2))),
        }
        for name, one in models.predictions.items()
    ]


def contrasts(models: Models, seed: int, resamples: int = 2000) -> list[Row]:
    """Return what the angle gains over each rival, with intervals by chain and Holm's correction.

    The differences of log-likelihoods are tested. Those of errors are given with intervals.

    Args:
        models: Predictions.
        seed: Of the resampling.
        resamples: Number of resamples.
    """
    sample = models.sample
    chain = sample.chain[sample.driver[sample.second]]
    observed = sample.table.acceleration[sample.second]
    rows = [
        _contrast(models.predictions, rival, observed, chain, seed, resamples) for rival in RIVALS
    ]
    for row, p in zip(rows, holm([row["p"] for row in rows]).tolist(), strict=True):
        row["p_holm"] = p
        row["found"] = bool(p <= ERROR and row["gain_nats"] > 0)
    return rows


def _contrast(
    predictions: Mapping[str, Prediction],
    rival: str,
    observed: Float[np.ndarray, " decision"],
    chain: np.ndarray,
    seed: int,
    resamples: int,
) -> Row:
    angle, other = predictions["angle"], predictions[rival]
    gain = cluster_mean(angle.log_likelihood - other.log_likelihood, chain, seed, resamples)
    squared = [(observed - one.mean) ** 2 for one in (other, angle)]
    less = cluster_mean(squared[0] - squared[1], chain, seed, resamples)
    return {
        "angle_over": rival,
        "gain_nats": gain.mean,
        "low": gain.low,
        "high": gain.high,
        "p": gain.p,
        "rmse_gain": 1.0 - float(np.sqrt(squared[1].mean() / squared[0].mean())),
        "less_squared_error": less.mean,
        "error_low": less.low,
        "error_high": less.high,
        "decisions": len(observed),
        "chains": gain.clusters,
    }


def chains_to_find_anything() -> int:
    """Return the fewest chains with which any contrast can be found at all."""
    return clusters_needed(ERROR, len(RIVALS))
