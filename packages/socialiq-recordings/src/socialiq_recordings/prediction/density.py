"""Densities of predicted accelerations: mixtures of Student's t with fitted scales."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy.special import logsumexp
from scipy.stats import t as student

FREEDOM = (2.0, 3.0, 5.0, 10.0, 30.0)
"""Degrees of freedom that are tried: from heavy tails to nearly normal."""

LEAST = 0.1
"""m/s²; least scale. Accelerations of a second from speeds that err by 0.07 m/s have it."""

_ROUNDS = 30  # of expectation and maximisation
_STAYING = 3.0  # degrees of freedom of the speeds of vehicles that stay
_MOST_STAY = 0.99


class Forecast(NamedTuple):
    """Predicted acceleration: a mixture of components with one scale.

    Attributes:
        log_weight: Logarithm of each component's weight; a row's weights sum to 1.
        centre: Of each component, m/s².
    """

    log_weight: Float64[np.ndarray, "moment component"]
    centre: Float64[np.ndarray, "moment component"]

    @staticmethod
    def at(mean: Float64[np.ndarray, " moment"]) -> Forecast:
        """Return forecasts of one component."""
        return Forecast(np.zeros((len(mean), 1)), mean[:, None])

    @property
    def mean(self) -> Float64[np.ndarray, " moment"]:
        """Mean acceleration, m/s²."""
        return (np.exp(self.log_weight) * self.centre).sum(axis=1)


@dataclass(frozen=True)
class Spread:
    """Student's t around a component, one for standing vehicles and one for moving ones.

    Attributes:
        freedom: Degrees of freedom, of standing and of moving vehicles.
        scale: m/s², likewise.
        stays: Share of the standing vehicles that stay, whatever their situation.
    """

    freedom: tuple[float, float]
    scale: tuple[float, float]
    stays: float

    @staticmethod
    def fit(
        error: Float64[np.ndarray, " moment"],
        acceleration: Float64[np.ndarray, " moment"],
        moving: Bool[np.ndarray, " moment"],
    ) -> Spread:
        """Return the most likely scales, degrees of freedom and share of those who stay.

        Args:
            error: Accelerations less their predictions, m/s².
            acceleration: m/s².
            moving: Whether each vehicle moves.
        """
        free_standing, scale, stays = _fit(error[~moving], acceleration[~moving], True)
        free_moving, faster, _ = _fit(error[moving], acceleration[moving], False)
        return Spread((free_standing, free_moving), (scale, faster), stays)

    def log_density(
        self,
        forecast: Forecast,
        acceleration: Float64[np.ndarray, " moment"],
        moving: Bool[np.ndarray, " moment"],
    ) -> Float64[np.ndarray, " moment"]:
        """Return the log-density of accelerations, 1 / (m/s²).

        Args:
            forecast: Of each moment.
            acceleration: m/s².
            moving: Whether each vehicle moves.
        """
        kind = moving.astype(np.int64)
        freedom, scale = np.array(self.freedom)[kind], np.array(self.scale)[kind]
        components = _log_t(
            acceleration[:, None] - forecast.centre, freedom[:, None], scale[:, None]
        )
        density = logsumexp(forecast.log_weight + components, axis=1)
        stays = np.where(moving, 0.0, self.stays)
        with np.errstate(divide="ignore"):
            return np.logaddexp(np.log1p(-stays) + density, np.log(stays) + _staying(acceleration))


def _log_t(off: Any, freedom: Any, scale: Any) -> Any:
    return student.logpdf(off / scale, freedom) - np.log(scale)


def _staying(acceleration: Float64[np.ndarray, " moment"]) -> Float64[np.ndarray, " moment"]:
    """Return the log-density of vehicles that stay: errors of their speeds are all they show."""
    return np.asarray(_log_t(acceleration, _STAYING, LEAST))


def _fit(
    error: Float64[np.ndarray, " moment"],
    acceleration: Float64[np.ndarray, " moment"],
    may_stay: bool,
) -> tuple[float, float, float]:
    """Return degrees of freedom, scale and the share that stays, of the largest likelihood.

    Expectation and maximisation for each of `FREEDOM` (Lange, Little and Taylor 1989).
    """
    if not len(error):
        return FREEDOM[-1], 1.0, 0.0
    fits, at_zero = [], _staying(acceleration)
    for freedom in FREEDOM:
        scale, stays = max(float(np.sqrt(np.mean(error**2))), LEAST), 0.5 * may_stay
        for _ in range(_ROUNDS):
            total, still = _shares(error, at_zero, freedom, scale, stays)
            weight = (1 - still) * (freedom + 1) / (freedom + (error / scale) ** 2)
            scale = np.sqrt((weight * error**2).sum() / max((1 - still).sum(), 1.0))
            scale, stays = max(float(scale), LEAST), min(float(still.mean()), _MOST_STAY)
        total, _ = _shares(error, at_zero, freedom, scale, stays)
        fits.append((float(total.sum()), freedom, scale, stays))
    return max(fits)[1:]


def _shares(
    error: np.ndarray, at_zero: np.ndarray, freedom: float, scale: float, stays: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return each acceleration's log-density, and the probability that its vehicle stays."""
    with np.errstate(divide="ignore"):
        staying = np.log(stays) + at_zero
    total = np.logaddexp(staying, np.log1p(-stays) + _log_t(error, freedom, scale))
    return total, np.exp(staying - total)
