"""Unlikeness: how far the features of a state are from those of a policy's training world.

It is the squared Mahalanobis distance of the outputs of the last hidden layer (Lee et al. 2018)
from their mean, by the shrunk covariance of Ledoit and Wolf (2004). Its unit is the distance that
one in a hundred held-out decisions exceeds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from socialiq.errors import UserError

RATES = np.arange(1, 501) / 1000
"""Rates of false alarms, per decision, that have a threshold."""
USUAL_RATE = 0.01
PREFIX = "unlikeness_"
"""Of the arrays in a policy's file."""

Features = Float[np.ndarray, "batch feature"]


@dataclass(frozen=True)
class Unlikeness:
    """Distance from the features of training, with thresholds by rates of false alarms.

    Attributes:
        mean: Of the features.
        factor: L of the inverse L Lᵀ of their covariance, by the root of the unit.
        thresholds: Distances that shares `RATES` of held-out decisions exceed; of `USUAL_RATE` 1.
    """

    mean: Float32[np.ndarray, " feature"]
    factor: Float32[np.ndarray, "feature feature"]
    thresholds: Float32[np.ndarray, " rate"]

    @staticmethod
    def fit(training: Features, held_out: Float[np.ndarray, "held feature"]) -> Unlikeness:
        """Fit the mean and the covariance to features, the thresholds to those of other episodes.

        The covariance is shrunk towards a multiple of the identity, so features that are constant
        in training have a small variance, not none.

        Args:
            training: Features, (row, feature), to which mean and covariance are fitted.
            held_out: Features of other episodes, (row, feature), to which the thresholds are
                fitted.

        Returns:
            The score.

        Raises:
            UserError: If no feature varies.
        """
        mean = training.mean(axis=0, dtype=np.float64)
        centred = training - mean
        rows, width = centred.shape
        covariance = centred.T @ centred / rows
        target = np.trace(covariance) / width * np.eye(width)
        if not target.any():
            raise UserError("no feature of this policy varies over its episodes: train it")
        away = ((covariance - target) ** 2).sum()
        error = (((centred**2).sum(axis=1) ** 2).mean() - (covariance**2).sum()) / rows
        weight = min(max(error / away, 1e-6), 1.0) if away else 1.0
        shrunk = (1.0 - weight) * covariance + weight * target
        factor = np.linalg.cholesky(np.linalg.inv(shrunk))
        distances = (((held_out - mean) @ factor) ** 2).sum(axis=1)
        thresholds = np.quantile(distances, 1.0 - RATES, method="higher")
        unit = np.interp(USUAL_RATE, RATES, thresholds)
        arrays = mean, factor / np.sqrt(unit), thresholds / unit
        return Unlikeness(*(array.astype(np.float32) for array in arrays))

    def __call__(self, features: Features) -> Float[np.ndarray, " batch"]:
        """Return the distance of each row of features."""
        return (((features - self.mean) @ self.factor) ** 2).sum(axis=1)

    @staticmethod
    def of_arrays(arrays: Mapping[str, np.ndarray], width: int) -> Unlikeness | None:
        """Return the score in a file's arrays.

        Args:
            arrays: Named arrays of the file; those of the score begin with `PREFIX`.
            width: Number of features that the score reads.

        Returns:
            The score; None if the arrays don't fit.
        """
        names = (PREFIX + name for name in Unlikeness.__dataclass_fields__)
        parts = [arrays[name].astype(np.float32) for name in names if name in arrays]
        fits = [part.shape for part in parts] == [(width,), (width, width), RATES.shape]
        return Unlikeness(*parts) if fits and (np.diff(parts[2]) <= 0).all() else None
