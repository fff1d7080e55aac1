"""Driver models: each fitted to training moments, predicting the next second's acceleration.

Learned models read `features`: bounded numbers of a situation, 0 where nothing is there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64

from socialiq.foreign import optional
from socialiq_recordings import DISTRIBUTION
from socialiq_recordings.physics import ballistic
from socialiq_recordings.prediction import following
from socialiq_recordings.prediction.density import Forecast, Spread
from socialiq_recordings.prediction.folds import grouped
from socialiq_recordings.prediction.following import literature, next_second
from socialiq_recordings.prediction.situations import HORIZON, Situations

NAMES = (
    "speed",
    "moving",
    "leader_near",
    "leader_headway",
    "leader_slower",
    "idm",
    "follower_near",
    "follower_faster",
    "junction_near",
    "left",
    "right",
    "limit",
    "gives_way",
    "conflict",
    "arrives",
    "other_arrives",
    "first",
    "merging",
    "other_speed",
)
"""Columns of `features`."""

_NEAR = 20.0  # m over which nearness falls by e
_SPEED = 10.0  # m/s
_LONG = 5.0  # s; longer times are all the same


def features(seen: Situations) -> Float64[np.ndarray, "moment feature"]:
    """Return what models learn from, in the order of `NAMES`; of about unit size.

    Args:
        seen: Situations.
    """
    leads, follows = np.isfinite(seen.gap), np.isfinite(seen.behind)
    conflict = seen.conflict
    arrives, other_arrives = (
        _time(gap, speed)
        for gap, speed in ((seen.to_area, seen.speed), (seen.other_to_area, seen.other_speed))
    )
    limit = np.where(np.isfinite(seen.limit), seen.limit, 0.0)
    columns = (
        seen.speed / _SPEED,
        seen.moving,
        _near(seen.gap),
        np.where(leads, 1 - _time(seen.gap, seen.speed) / _LONG, 0.0),
        np.where(leads, (seen.speed - seen.leader_speed) / _SPEED, 0.0),
        np.clip(next_second(literature(), seen), -4.0, 2.0),
        _near(seen.behind),
        np.where(follows, (seen.behind_speed - seen.speed) / _SPEED, 0.0),
        _near(seen.to_junction),
        np.clip(seen.turn, 0.0, 90.0) / 90.0,
        np.clip(-seen.turn, 0.0, 90.0) / 90.0,
        limit / _SPEED,
        seen.gives_way,
        conflict,
        np.where(conflict, 1 - arrives / _LONG, 0.0),
        np.where(conflict, 1 - other_arrives / _LONG, 0.0),
        np.where(conflict, np.clip(other_arrives - arrives, -_LONG, _LONG) / _LONG, 0.0),
        seen.merging & conflict,
        np.where(conflict, seen.other_speed / _SPEED, 0.0),
    )
    return np.stack([np.asarray(column, np.float64) for column in columns], axis=1)


def _near(metres: Float64[np.ndarray, " moment"]) -> Float64[np.ndarray, " moment"]:
    return np.exp(-np.maximum(metres, 0.0) / _NEAR)


def _time(
    metres: Float64[np.ndarray, " moment"], speed: Float64[np.ndarray, " moment"]
) -> Float64[np.ndarray, " moment"]:
    """Return the time to drive a distance, s; at most `_LONG`, also where nothing is there."""
    return np.clip(np.maximum(metres, 0.0) / np.maximum(speed, 0.1), 0.0, _LONG)


Residuals = Float64[np.ndarray, " moment"]

BASE = "boosting, last residual"
"""The model whose choices an angle tilts."""

TRIVIAL = ("constant speed", "last acceleration")
"""Models that everything is compared with."""


class Task(NamedTuple):
    """Data that the models of a fold may learn from.

    Attributes:
        train: Training moments.
        residual: Of each: observed less fitted IDM's acceleration of the decision before; 0
            without one.
        first: Whether each is in the first half of its driver's conflicts.
        own: Moments in the first halves of the drivers that are predicted.
        own_residual: Residuals of these.
        idm: Log-parameters of the IDM fitted to the training moments.
        seed: Seed of what is drawn.
    """

    train: Situations
    residual: Residuals
    first: Bool[np.ndarray, " moment"]
    own: Situations
    own_residual: Residuals
    idm: Float64[np.ndarray, " parameter"]
    seed: int


class Fitted(NamedTuple):
    """Fitted model.

    Attributes:
        forecast: Acceleration of the next second from situations and last residuals.
        spread: Density around it.
        personal: Whether it learned from drivers' own first halves.
        inferred: Numbers that it inferred, by name.
    """

    forecast: Callable[[Situations, Residuals], Forecast]
    spread: Spread
    personal: bool = False
    inferred: Mapping[str, float] = {}


def residuals(idm: Float64[np.ndarray, " parameter"], seen: Situations) -> Residuals:
    """Return observed less the IDM's acceleration of each driver's moment before; 0 without one.

    Args:
        idm: Log-parameters.
        seen: Moments, with all earlier ones of their drivers.
    """
    off, before = seen.acceleration - following.next_second(idm, seen), seen.previous()
    return np.where(before >= 0, off[before], 0.0)


def rollout(
    fitted: Fitted, idm: Float64[np.ndarray, " parameter"], seen: Situations, residual: Residuals
) -> Float64[np.ndarray, " moment"]:
    """Return the distances after `HORIZON` s of the mean accelerations, m.

    All others keep their speeds.

    Args:
        fitted: The model.
        idm: Log-parameters of which the residuals are.
        seen: Situations.
        residual: Last residuals.
    """
    total = np.zeros(len(seen))
    for _ in range(HORIZON):
        rate = fitted.forecast(seen, residual).mean
        total += ballistic(seen.speed, rate, 1.0)[0]
        residual = rate - following.next_second(idm, seen)
        seen = seen.advanced(rate)
    return total


def _of_mean(
    mean: Callable[[Situations, Residuals], Any],
    task: Task,
    errors: np.ndarray | None = None,
    personal: bool = False,
) -> Fitted:
    """Return a model of a mean; its spread is that of its errors in training, if none are given."""
    off = task.train.acceleration - mean(task.train, task.residual) if errors is None else errors
    spread = Spread.fit(off, task.train.acceleration, task.train.moving)
    return Fitted(lambda seen, last: Forecast.at(mean(seen, last)), spread, personal)


def constant_speed(task: Task) -> Fitted:
    """Return the model without acceleration."""
    return _of_mean(lambda seen, _: np.zeros(len(seen)), task)


def last_acceleration(task: Task) -> Fitted:
    """Return the model of a fitted share of the last second's acceleration."""
    share = _share(_last(task.train), task.train.acceleration)
    return _of_mean(lambda seen, _: share * _last(seen), task)


def idm_literature(task: Task) -> Fitted:
    """Return the IDM with the parameters of the literature."""
    return _of_mean(lambda seen, _: following.next_second(following.literature(), seen), task)


def idm_fitted(task: Task) -> Fitted:
    """Return the IDM fitted to all training moments."""
    return _of_mean(lambda seen, _: following.next_second(task.idm, seen), task)


def idm_residual(task: Task) -> Fitted:
    """Return the fitted IDM and a fitted share of the driver's last residual."""
    off = task.train.acceleration - following.next_second(task.idm, task.train)
    share = _share(task.residual, off)
    return _of_mean(lambda seen, last: following.next_second(task.idm, seen) + share * last, task)


def idm_by_driver(task: Task) -> Fitted:
    """Return the IDM fitted to each driver's first half, shrunk towards the population.

    How much drivers differ is chosen by the second halves of the training drivers, whose errors
    also give the spread.
    """
    off = task.train.acceleration - following.next_second(task.idm, task.train)
    error = max(float(np.sqrt(np.mean(np.minimum(off**2, 9.0)))), 0.1)
    spread = following.best_spread(task.idm, task.train, task.first, error)

    def mean_of(own: Situations) -> Callable[[Situations, Residuals], Any]:
        drivers = following.fit_drivers(task.idm, own, error, spread)
        return lambda seen, _: following.next_second(
            following.of_drivers(task.idm, drivers, seen), seen
        )

    # Of first halves, from which drivers' parameters come, the errors are those of the population.
    trained = mean_of(task.train.rows(task.first))
    errors = np.where(task.first, off, task.train.acceleration - trained(task.train, task.residual))
    spread_of_errors = Spread.fit(errors, task.train.acceleration, task.train.moving)
    personal = mean_of(task.own)
    return Fitted(lambda seen, last: Forecast.at(personal(seen, last)), spread_of_errors, True)


def boosting(task: Task) -> Fitted:
    """Return gradient boosting of the situation."""
    return _boosted(task, lambda seen, _: features(seen))


def boosting_residual(task: Task) -> Fitted:
    """Return gradient boosting of the situation, the last acceleration and the last residual."""
    return _boosted(task, lambda seen, last: np.column_stack([features(seen), _last(seen), last]))


def _boosted(task: Task, inputs: Callable[[Situations, Residuals], Any]) -> Fitted:
    """Return gradient boosting; its spread is of errors for drivers that it was not trained on."""
    columns, target = inputs(task.train, task.residual), task.train.acceleration
    group = grouped(task.train.vehicle, 5)
    errors = np.zeros(len(target))
    for number in np.unique(group):
        besides = group != number if (group != number).any() else group == number
        trees = _trees(task.seed).fit(columns[besides], target[besides])
        errors[group == number] = target[group == number] - trees.predict(columns[group == number])
    trees = _trees(task.seed).fit(columns, target)
    return _of_mean(lambda seen, last: trees.predict(inputs(seen, last)), task, errors)


def ensembles() -> Any:
    """Return scikit-learn's module of gradient boosting.

    Raises:
        UserError: If it is not installed.
    """
    return optional("sklearn.ensemble", "prediction", "gradient boosting", DISTRIBUTION)


def _trees(seed: int) -> Any:
    return ensembles().HistGradientBoostingRegressor(
        learning_rate=0.05,
        max_iter=150,
        max_leaf_nodes=8,
        min_samples_leaf=10,
        l2_regularization=1.0,
        early_stopping=False,
        random_state=seed,
    )


def _last(seen: Situations) -> Float64[np.ndarray, " moment"]:
    return np.nan_to_num(seen.last)


def _share(given: np.ndarray, target: np.ndarray) -> float:
    """Return the factor of the least squares."""
    return float(given @ target / max(float(given @ given), 1e-9))


MODELS: dict[str, Callable[[Task], Fitted]] = {
    "constant speed": constant_speed,
    "last acceleration": last_acceleration,
    "IDM, literature": idm_literature,
    "IDM, fitted": idm_fitted,
    "IDM, by driver": idm_by_driver,
    "IDM, last residual": idm_residual,
    "boosting": boosting,
    BASE: boosting_residual,
}
"""Models that are fitted fold by fold; `learned` trains the policies of all folds at once."""
