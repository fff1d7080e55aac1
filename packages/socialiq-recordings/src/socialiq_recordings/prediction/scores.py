"""Scores of driver models: log-likelihood, error and displacement, with intervals by chain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from socialiq.statistics.clusters import cluster_mean
from socialiq.types import Row
from socialiq_recordings.conflicts.table import known
from socialiq_recordings.prediction.models import TRIVIAL

SUBSETS = ("all", "moving", "conflict")
"""All moments, those of moving vehicles, and those of moving vehicles in a conflict."""

PARTS = ("all", "second half")
"""Moments of all drivers, or those in the second halves of drivers' conflicts. Models that learned
from a driver's first half are only scored on its second."""


class Predicted(NamedTuple):
    """Predictions of one model for the moments that a holdout tests.

    Attributes:
        model: Name.
        personal: Whether it learned from drivers' first halves.
        log_density: Of the observed acceleration.
        mean: Predicted acceleration, m/s².
        driven: Predicted distance after 3 s, m.
    """

    model: str
    personal: bool
    log_density: Float64[np.ndarray, " moment"]
    mean: Float64[np.ndarray, " moment"]
    driven: Float64[np.ndarray, " moment"]


class Held(NamedTuple):
    """Moments that a holdout tests, each once.

    Attributes:
        holdout: What is held out.
        acceleration: Observed, m/s².
        driven: Observed distance after 3 s, m; NaN if not seen.
        chain: Number of each moment's chain.
        vehicle: Number of each moment's driver.
        moving: Whether it moves.
        conflict: Whether it is in a conflict.
        second: Whether the moment is in the second half of the driver's conflicts.
        predicted: Of every model.
    """

    holdout: str
    acceleration: Float64[np.ndarray, " moment"]
    driven: Float64[np.ndarray, " moment"]
    chain: Int64[np.ndarray, " moment"]
    vehicle: Int64[np.ndarray, " moment"]
    moving: Bool[np.ndarray, " moment"]
    conflict: Bool[np.ndarray, " moment"]
    second: Bool[np.ndarray, " moment"]
    predicted: Sequence[Predicted]

    def mask(self, subset: str, part: str) -> Bool[np.ndarray, " moment"]:
        """Return the moments of a subset and a part."""
        kinds = {
            "all": np.ones(len(self.moving), bool),
            "moving": self.moving,
            "conflict": self.moving & self.conflict,
        }
        return kinds[subset] & (self.second | (part == "all"))


def scores(tested: Held, seed: int, resamples: int) -> list[Row]:
    """Return a row for each subset, part and model; an interval of one chain is None.

    Args:
        tested: Moments with predictions.
        seed: Of the resampling of chains.
        resamples: Number of resamples.
    """
    rows: list[Row] = []
    for subset in SUBSETS:
        for part in PARTS:
            mask = tested.mask(subset, part)
            models = [one for one in tested.predicted if part != "all" or not one.personal]
            if mask.any():
                rows += _rows(tested, models, mask, (seed, resamples), subset, part)
    return [{name: known(value) for name, value in row.items()} for row in rows]


def _rows(
    tested: Held,
    models: Sequence[Predicted],
    mask: Bool[np.ndarray, " moment"],
    drawn: tuple[int, int],
    subset: str,
    part: str,
) -> list[Row]:
    chain = tested.chain[mask]
    best = better_trivial(models, mask)
    seen = mask & np.isfinite(tested.driven)
    rows = []
    for one in models:
        surprise = cluster_mean(-one.log_density[mask], chain, *drawn)
        squared = cluster_mean((one.mean - tested.acceleration)[mask] ** 2, chain, *drawn)
        row: Row = {
            "holdout": tested.holdout,
            "moments": subset,
            "part": part,
            "model": one.model,
            "n": int(mask.sum()),
            "drivers": len(np.unique(tested.vehicle[mask])),
            "chains": surprise.clusters,
            "surprise": surprise.mean,
            "surprise_low": surprise.low,
            "surprise_high": surprise.high,
            "rmse": float(np.sqrt(squared.mean)),
            "rmse_low": float(np.sqrt(squared.low)),
            "rmse_high": float(np.sqrt(squared.high)),
        }
        rows.append(
            row | _displacement(tested, one, seen, drawn) | _gain(one, best, mask, chain, drawn)
        )
    return rows


def better_trivial(
    models: Sequence[Predicted], mask: Bool[np.ndarray, " moment"]
) -> Predicted | None:
    """Return the trivial model that predicts some moments better; None without any.

    Args:
        models: All models.
        mask: The moments.
    """
    trivial = [one for one in models if one.model in TRIVIAL]
    return max(trivial, key=lambda one: one.log_density[mask].mean()) if trivial else None


def _displacement(
    tested: Held, one: Predicted, seen: Bool[np.ndarray, " moment"], drawn: tuple[int, int]
) -> Row:
    """Return the mean distance at 3 s between predicted and observed positions along the way."""
    names = ("displacement", "displacement_low", "displacement_high")
    if not seen.any():
        return dict.fromkeys(names) | {"n_displacement": 0}
    off = np.abs(one.driven - tested.driven)[seen]
    found = cluster_mean(off, tested.chain[seen], *drawn)
    return dict(zip(names, found[:3], strict=True)) | {"n_displacement": int(seen.sum())}


def _gain(
    one: Predicted,
    best: Predicted | None,
    mask: Bool[np.ndarray, " moment"],
    chain: Int64[np.ndarray, " chosen"],
    drawn: tuple[int, int],
) -> Row:
    """Return the gain over the better trivial model, nats."""
    if best is None:
        return {}
    more = cluster_mean((one.log_density - best.log_density)[mask], chain, *drawn)
    return {"over": best.model, "gain": more.mean, "gain_low": more.low, "gain_high": more.high}
