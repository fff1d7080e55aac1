"""IDM as a driver model, and the features of situations that learned models read.

The IDM is fitted to a population and, shrunk towards it, to each driver.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from socialiq.physics import ballistic
from socialiq_recordings.idm import Idm, acceleration, calibrate
from socialiq_recordings.prediction.situations import Situations

FITTED = Idm._fields  # parameters that are fitted; all are above 0, so that their logarithms are
LOW, HIGH = np.log([3.0, 0.2, 0.3, 0.1, 0.3]), np.log([40.0, 6.0, 8.0, 5.0, 9.0])
"""Range of the fitted parameters, in logarithms: beyond are errors of a fit, not drivers."""

SPREADS = (0.03, 0.1, 0.3, 1.0)  # standard deviations of drivers' log-parameters that are tried
_STEPS = 5  # of a second
_STEP = 1e-3  # of a log-parameter, for derivatives
_ROUNDS = 3  # of Gauss and Newton
_HOLD = 0.05  # m/s² per unit of a log-parameter; holds what the data don't determine

Parameters = Float64[np.ndarray, " parameter"]
"""Logarithms of the parameters `FITTED`."""
OfMoments = Float64[np.ndarray, " moment"]


def literature() -> Parameters:
    """Return the log-parameters of `Idm`."""
    return np.log(Idm())


def accelerations(
    log_parameters: Float64[np.ndarray, "*some parameter"],
    speed: Float64[np.ndarray, "*#shape"],
    gap: Float64[np.ndarray, "*#shape"],
    leader_speed: Float64[np.ndarray, "*#shape"],
) -> Float64[np.ndarray, "*#shape"]:
    """Return accelerations of the IDM, m/s², of one set of parameters or one for each vehicle.

    Speeds in m/s; the gap is to the leader's rear, m, infinite without a leader.
    """
    desired, headway, jam, strongest, comfort = np.moveaxis(np.exp(log_parameters), -1, 0)
    return acceleration(speed, gap, leader_speed, desired, headway, jam, strongest, comfort)


def next_second(
    log_parameters: Float64[np.ndarray, "*some parameter"], situations: Situations
) -> OfMoments:
    """Return the mean acceleration of the next second behind a leader that keeps its speed, m/s².

    Of one set of parameters, or one for each moment.
    """
    speed, gap, dt = situations.speed, situations.gap, 1.0 / _STEPS
    for _ in range(_STEPS):
        rate = accelerations(log_parameters, speed, gap, situations.leader_speed)
        driven, speed = ballistic(speed, rate, dt)
        gap = gap + situations.leader_speed * dt - driven
    return speed - situations.speed


def fit_population(train: Situations) -> Parameters:
    """Return the log-parameters with the least robust error of the next second's acceleration."""
    start, root = literature(), np.sqrt(max(len(train), 1))

    def errors(log_parameters: Any) -> Any:
        off = next_second(log_parameters, train) - train.acceleration
        return np.append(off / root, _HOLD * (log_parameters - start))

    return calibrate(errors, start, (LOW, HIGH), evaluations=60)


def fit_drivers(
    population: Parameters, situations: Situations, error: float, spread: float
) -> dict[int, Parameters]:
    """Return the most probable log-parameters of each driver.

    Accelerations are normal around the IDM's, with the deviation `error` in m/s², log-parameters
    around the population's, with the deviation `spread`; steps of Gauss and Newton for all drivers
    at once, from their moments that may be learned from.
    """
    vehicles, driver = np.unique(situations.vehicle, return_inverse=True)
    fitted = np.tile(population, (len(vehicles), 1))
    size = len(population)
    for _ in range(_ROUNDS):
        modelled = next_second(fitted[driver], situations)
        off = situations.acceleration - modelled
        steps = fitted[driver][:, None, :] + _STEP * np.eye(size)
        moved = [next_second(steps[:, k], situations) - modelled for k in range(size)]
        slopes = np.stack(moved, axis=1) / _STEP
        curvature = np.tile(np.eye(size) / spread**2, (len(vehicles), 1, 1))
        np.add.at(curvature, driver, slopes[:, :, None] * slopes[:, None, :] / error**2)
        pull = (population - fitted) / spread**2
        np.add.at(pull, driver, slopes * off[:, None] / error**2)
        fitted = np.clip(fitted + np.linalg.solve(curvature, pull[..., None])[..., 0], LOW, HIGH)
    return dict(zip(vehicles.tolist(), fitted, strict=True))


def of_drivers(
    population: Parameters, drivers: dict[int, Parameters], situations: Situations
) -> Float64[np.ndarray, "moment parameter"]:
    """Return the log-parameters of each moment's driver; the population's of an unknown one."""
    rows = [drivers.get(vehicle, population) for vehicle in situations.vehicle.tolist()]
    return np.array(rows).reshape(len(situations), len(population))


def best_spread(
    population: Parameters, train: Situations, first: Bool[np.ndarray, " moment"], error: float
) -> float:
    """Return the spread with which first halves of training drivers predict second halves best."""
    later = train.rows(~first)

    def missed(spread: float) -> float:
        drivers = fit_drivers(population, train.rows(first), error, spread)
        off = next_second(of_drivers(population, drivers, later), later) - later.acceleration
        return float(np.abs(off).sum())

    return min(SPREADS, key=missed)


_NEAR = 20.0  # m over which nearness falls by e
_SPEED = 10.0  # m/s
_LONG = 5.0  # s; longer times are all the same


def features(situations: Situations) -> Float64[np.ndarray, "moment feature"]:
    """Return what models learn from: numbers of about unit size, 0 where nothing is there."""
    leads, follows = np.isfinite(situations.gap), np.isfinite(situations.behind)
    conflict, slower = situations.conflict, situations.speed - situations.leader_speed
    faster = situations.behind_speed - situations.speed
    arrives = _time(situations.to_area, situations.speed)
    other_arrives = _time(situations.other_to_area, situations.other_speed)
    columns = {
        "speed": situations.speed / _SPEED,
        "moving": situations.moving,
        "leader_near": _near(situations.gap),
        "leader_headway": np.where(leads, 1 - _time(situations.gap, situations.speed) / _LONG, 0.0),
        "leader_slower": np.where(leads, slower / _SPEED, 0.0),
        "idm": np.clip(next_second(literature(), situations), -4.0, 2.0),
        "follower_near": _near(situations.behind),
        "follower_faster": np.where(follows, faster / _SPEED, 0.0),
        "junction_near": _near(situations.to_junction),
        "left": np.clip(situations.turn, 0.0, 90.0) / 90.0,
        "right": np.clip(-situations.turn, 0.0, 90.0) / 90.0,
        "limit": np.where(np.isfinite(situations.limit), situations.limit, 0.0) / _SPEED,
        "gives_way": situations.gives_way,
        "conflict": conflict,
        "arrives": np.where(conflict, 1 - arrives / _LONG, 0.0),
        "other_arrives": np.where(conflict, 1 - other_arrives / _LONG, 0.0),
        "first": np.where(conflict, np.clip(other_arrives - arrives, -_LONG, _LONG) / _LONG, 0.0),
        "merging": situations.merging & conflict,
        "other_speed": np.where(conflict, situations.other_speed / _SPEED, 0.0),
    }
    return np.stack([np.asarray(column, np.float64) for column in columns.values()], axis=1)


def _near(metres: OfMoments) -> OfMoments:
    return np.exp(-np.maximum(metres, 0.0) / _NEAR)


def _time(metres: OfMoments, speed: OfMoments) -> OfMoments:
    """Return the time to drive a distance, s; at most `_LONG`, also where nothing is there."""
    return np.clip(np.maximum(metres, 0.0) / np.maximum(speed, 0.1), 0.0, _LONG)
