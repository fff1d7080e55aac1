"""Driver models: each fitted to training moments, predicting the next second's acceleration.

A prediction is a mixture of Student's t around the components of a forecast, with a fitted scale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy.special import logsumexp
from scipy.stats import t as student

from socialiq.foreign import optional
from socialiq.physics import ballistic
from socialiq_recordings import DISTRIBUTION
from socialiq_recordings.prediction import following
from socialiq_recordings.prediction.following import features, next_second
from socialiq_recordings.prediction.situations import HORIZON, Situations, grouped

FREEDOM = (2.0, 3.0, 5.0, 10.0, 30.0)
"""Degrees of freedom that are tried: from heavy tails to nearly normal."""

LEAST = 0.1  # m/s²; least scale. Accelerations of a second from speeds that err by 0.07 m/s have it
_ROUNDS = 30  # of expectation and maximisation
_STAYING = 3.0  # degrees of freedom of the speeds of vehicles that stay
_MOST_STAY = 0.99

Numbers = Float64[np.ndarray, " moment"]


class Forecast(NamedTuple):
    """Predicted acceleration: a mixture of components with one scale."""

    # logarithm of each component's weight; a row's weights sum to 1
    log_weight: Float64[np.ndarray, "moment component"]
    centre: Float64[np.ndarray, "moment component"]  # of each component, m/s²

    @staticmethod
    def at(mean: Numbers) -> Forecast:
        """Return forecasts of one component."""
        return Forecast(np.zeros((len(mean), 1)), mean[:, None])

    @property
    def mean(self) -> Numbers:
        """Mean acceleration, m/s²."""
        return (np.exp(self.log_weight) * self.centre).sum(axis=1)


@dataclass(frozen=True)
class Spread:
    """Student's t around a component, one for standing vehicles and one for moving ones."""

    freedom: tuple[float, float]  # degrees of freedom, of standing and of moving vehicles
    scale: tuple[float, float]  # m/s², likewise
    stays: float  # share of the standing vehicles that stay, whatever their situation

    @staticmethod
    def fit(error: Numbers, acceleration: Numbers, moving: Bool[np.ndarray, " moment"]) -> Spread:
        """Return the most likely scales, degrees of freedom and share of those who stay.

        `error` are accelerations less their predictions, m/s².
        """
        free_standing, scale, stays = _fit(error[~moving], acceleration[~moving], True)
        free_moving, faster, _ = _fit(error[moving], acceleration[moving], False)
        return Spread((free_standing, free_moving), (scale, faster), stays)

    def log_density(
        self, forecast: Forecast, acceleration: Numbers, moving: Bool[np.ndarray, " moment"]
    ) -> Numbers:
        """Return the log-density of accelerations in m/s², 1 / (m/s²)."""
        kind = moving.astype(np.int64)
        freedom, scale = np.array(self.freedom)[kind], np.array(self.scale)[kind]
        off = acceleration[:, None] - forecast.centre
        components = _log_t(off, freedom[:, None], scale[:, None])
        density = logsumexp(forecast.log_weight + components, axis=1)
        stays = np.where(moving, 0.0, self.stays)
        with np.errstate(divide="ignore"):
            return np.logaddexp(np.log1p(-stays) + density, np.log(stays) + _staying(acceleration))


def _log_t(off: Any, freedom: Any, scale: Any) -> Any:
    return student.logpdf(off / scale, freedom) - np.log(scale)


def _staying(acceleration: Numbers) -> Numbers:
    """Return the log-density of vehicles that stay: errors of their speeds are all they show."""
    return np.asarray(_log_t(acceleration, _STAYING, LEAST))


def _fit(error: Numbers, acceleration: Numbers, may_stay: bool) -> tuple[float, float, float]:
    """Return the likeliest degrees of freedom, scale and staying share (Lange et al. 1989)."""
    if not len(error):
        return FREEDOM[-1], 1.0, 0.0
    fits, at_zero = [], _staying(acceleration)

    def totals(freedom: float, scale: float, stays: float) -> tuple[np.ndarray, np.ndarray]:
        """Return each log-density, and the probability that the vehicle stays."""
        with np.errstate(divide="ignore"):
            staying = np.log(stays) + at_zero
        total = np.logaddexp(staying, np.log1p(-stays) + _log_t(error, freedom, scale))
        return total, np.exp(staying - total)

    for freedom in FREEDOM:
        scale, stays = max(float(np.sqrt(np.mean(error**2))), LEAST), 0.5 * may_stay
        for _ in range(_ROUNDS):
            _, still = totals(freedom, scale, stays)
            weight = (1 - still) * (freedom + 1) / (freedom + (error / scale) ** 2)
            scale = np.sqrt((weight * error**2).sum() / max((1 - still).sum(), 1.0))
            scale, stays = max(float(scale), LEAST), min(float(still.mean()), _MOST_STAY)
        fits.append((float(totals(freedom, scale, stays)[0].sum()), freedom, scale, stays))
    return max(fits)[1:]


BASE = "boosting, last residual"
"""The model whose choices an angle tilts."""

TRIVIAL = ("constant speed", "last acceleration")
"""Models that everything is compared with."""


class Task(NamedTuple):
    """Data that the models of a fold may learn from."""

    train: Situations  # training moments
    # of each: observed less fitted IDM's acceleration of the decision before; 0 without one
    residual: Numbers
    # whether each is in the first half of its driver's conflicts
    first: Bool[np.ndarray, " moment"]
    own: Situations  # moments in the first halves of the drivers that are predicted
    idm: following.Parameters  # log-parameters of the IDM fitted to the training moments
    seed: int  # seed of what is drawn


Model = Callable[[Situations, Numbers], Any]
"""Function of situations and last residuals."""


class Fitted(NamedTuple):
    """Fitted model."""

    forecast: Model  # `Forecast` of the acceleration of the next second
    spread: Spread  # density around it
    personal: bool = False  # whether it learned from drivers' own first halves
    inferred: Mapping[str, float] = {}  # numbers that it inferred, by name


def residuals(idm: following.Parameters, situations: Situations) -> Numbers:
    """Return observed less the IDM's acceleration of each driver's moment before; 0 without one.

    All earlier moments of the drivers must be among the situations.
    """
    off, before = situations.acceleration - next_second(idm, situations), situations.previous()
    return np.where(before >= 0, off[before], 0.0)


def rollout(
    fitted: Fitted, idm: following.Parameters, situations: Situations, residual: Numbers
) -> Numbers:
    """Return the distances after `HORIZON` s of a model's mean accelerations, m.

    All others keep their speeds. `residual` are the last residuals of the IDM `idm`.
    """
    total, moments = np.zeros(len(situations)), situations
    for _ in range(HORIZON):
        rate = fitted.forecast(moments, residual).mean
        total += ballistic(moments.speed, rate, 1.0)[0]
        residual = rate - next_second(idm, moments)
        moments = moments.advanced(rate)
    return total


def _of_mean(mean: Model, task: Task, errors: np.ndarray | None = None) -> Fitted:
    """Return a model of a mean; its spread is that of its errors in training, if none are given."""
    off = task.train.acceleration - mean(task.train, task.residual) if errors is None else errors
    spread = Spread.fit(off, task.train.acceleration, task.train.moving)
    return Fitted(lambda situations, last: Forecast.at(mean(situations, last)), spread)


def _last_acceleration(task: Task) -> Fitted:
    """Return the model of a fitted share of the last second's acceleration."""
    share = _share(_last(task.train), task.train.acceleration)
    return _of_mean(lambda situations, _: share * _last(situations), task)


def _idm(parameters: following.Parameters) -> Model:
    return lambda situations, _: next_second(parameters, situations)


def _idm_residual(task: Task) -> Fitted:
    """Return the fitted IDM and a fitted share of the driver's last residual."""
    off = task.train.acceleration - next_second(task.idm, task.train)
    share = _share(task.residual, off)
    return _of_mean(lambda situations, last: next_second(task.idm, situations) + share * last, task)


def _idm_by_driver(task: Task) -> Fitted:
    """Return the IDM fitted to each driver's first half, shrunk towards the population."""
    off = task.train.acceleration - next_second(task.idm, task.train)
    error = max(float(np.sqrt(np.mean(np.minimum(off**2, 9.0)))), 0.1)
    spread = following.best_spread(task.idm, task.train, task.first, error)

    def mean_of(first: Situations) -> Model:
        drivers = following.fit_drivers(task.idm, first, error, spread)
        return lambda situations, _: next_second(
            following.of_drivers(task.idm, drivers, situations), situations
        )

    # Of first halves, from which drivers' parameters come, the errors are those of the population.
    trained = mean_of(task.train.rows(task.first))
    errors = np.where(task.first, off, task.train.acceleration - trained(task.train, task.residual))
    return _of_mean(mean_of(task.own), task, errors)._replace(personal=True)


def _boosted(task: Task, inputs: Model) -> Fitted:
    """Return gradient boosting; its spread is of errors for drivers that it was not trained on."""
    columns, target = inputs(task.train, task.residual), task.train.acceleration

    def trees(rows: np.ndarray) -> Any:
        sizes = {"max_iter": 150, "max_leaf_nodes": 8, "min_samples_leaf": 10}
        rates = {"learning_rate": 0.05, "l2_regularization": 1.0, "early_stopping": False}
        boosting = ensembles().HistGradientBoostingRegressor
        return boosting(**sizes, **rates, random_state=task.seed).fit(columns[rows], target[rows])

    group = grouped(task.train.vehicle, 5)
    errors = np.zeros(len(target))
    for number in np.unique(group):
        rows = group == number
        fitted = trees(~rows if not rows.all() else rows)
        errors[rows] = target[rows] - fitted.predict(columns[rows])
    fitted = trees(np.ones(len(target), bool))
    return _of_mean(lambda situations, last: fitted.predict(inputs(situations, last)), task, errors)


def ensembles() -> Any:
    """Return scikit-learn's module of gradient boosting; `UserError` if it is not installed."""
    return optional("sklearn.ensemble", "prediction", "gradient boosting", DISTRIBUTION)


def _last(situations: Situations) -> Numbers:
    return np.nan_to_num(situations.last)


def _share(numbers: np.ndarray, target: np.ndarray) -> float:
    """Return the factor of the least squares."""
    return float(numbers @ target / max(float(numbers @ numbers), 1e-9))


MODELS: dict[str, Callable[[Task], Fitted]] = {
    "constant speed": lambda task: _of_mean(lambda moments, _: np.zeros(len(moments)), task),
    "last acceleration": _last_acceleration,
    "IDM, literature": lambda task: _of_mean(_idm(following.literature()), task),
    "IDM, fitted": lambda task: _of_mean(_idm(task.idm), task),
    "IDM, by driver": _idm_by_driver,
    "IDM, last residual": _idm_residual,
    "boosting": lambda task: _boosted(task, lambda moments, _: features(moments)),
    BASE: lambda task: _boosted(
        task, lambda moments, last: np.column_stack([features(moments), _last(moments), last])
    ),
}
"""Models that are fitted fold by fold; `learned` trains the policies of all folds at once."""
