"""IDM as a driver model: fitted to a population and, shrunk towards it, to each driver."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float64
from scipy.optimize import least_squares

from socialiq_recordings.physics import Idm, acceleration, ballistic
from socialiq_recordings.prediction.situations import Situations

FITTED = Idm._fields
"""Parameters that are fitted; all are above 0, so that their logarithms are."""

LOW, HIGH = np.log([3.0, 0.2, 0.3, 0.1, 0.3]), np.log([40.0, 6.0, 8.0, 5.0, 9.0])
"""Range of the fitted parameters, in logarithms: beyond are errors of a fit, not drivers."""

SPREADS = (0.03, 0.1, 0.3, 1.0)
"""Standard deviations of drivers' log-parameters that are tried."""

_STEPS = 5  # of a second
_STEP = 1e-3  # of a log-parameter, for derivatives
_ROUNDS = 3  # of Gauss and Newton
_HOLD = 0.05  # m/s² per unit of a log-parameter; holds what the data don't determine


def literature() -> Float64[np.ndarray, " parameter"]:
    """Return the log-parameters of `Idm`."""
    return np.log(Idm())


def accelerations(
    log_parameters: Float64[np.ndarray, "*some parameter"],
    speed: Float64[np.ndarray, "*#shape"],
    gap: Float64[np.ndarray, "*#shape"],
    leader_speed: Float64[np.ndarray, "*#shape"],
) -> Float64[np.ndarray, "*#shape"]:
    """Return accelerations of the IDM, m/s².

    Args:
        log_parameters: Of `FITTED` along the last axis; one set, or one for each vehicle.
        speed: m/s.
        gap: To the leader's rear, m; infinite without a leader.
        leader_speed: m/s.
    """
    desired, headway, jam, strongest, comfort = np.moveaxis(np.exp(log_parameters), -1, 0)
    return acceleration(speed, gap, leader_speed, desired, headway, jam, strongest, comfort)


def next_second(
    log_parameters: Float64[np.ndarray, "*some parameter"], seen: Situations
) -> Float64[np.ndarray, " moment"]:
    """Return the mean acceleration of the next second behind a leader that keeps its speed.

    Args:
        log_parameters: Of `FITTED`; one set, or one for each moment.
        seen: Situations.
    """
    speed, gap, dt = seen.speed, seen.gap, 1.0 / _STEPS
    for _ in range(_STEPS):
        rate = accelerations(log_parameters, speed, gap, seen.leader_speed)
        driven, speed = ballistic(speed, rate, dt)
        gap = gap + seen.leader_speed * dt - driven
    return speed - seen.speed


def fit_population(train: Situations) -> Float64[np.ndarray, " parameter"]:
    """Return the log-parameters with the least robust error of the next second's acceleration.

    Args:
        train: Moments with their accelerations.
    """
    start, root = literature(), np.sqrt(max(len(train), 1))

    def errors(log_parameters: Any) -> Any:
        off = next_second(log_parameters, train) - train.acceleration
        return np.append(off / root, _HOLD * (log_parameters - start))

    fit = least_squares(errors, start, bounds=(LOW, HIGH), loss="soft_l1", max_nfev=60)
    return np.asarray(fit.x)


def fit_drivers(
    population: Float64[np.ndarray, " parameter"],
    own: Situations,
    error: float,
    spread: float,
) -> dict[int, Float64[np.ndarray, " parameter"]]:
    """Return the most probable log-parameters of each driver.

    Accelerations are normal around the IDM's and log-parameters around the population's; steps of
    Gauss and Newton for all drivers at once.

    Args:
        population: Its log-parameters.
        own: Moments of the drivers that may be learned from.
        error: Standard deviation of the accelerations, m/s².
        spread: Standard deviation of drivers' log-parameters.
    """
    vehicles, driver = np.unique(own.vehicle, return_inverse=True)
    fitted = np.tile(population, (len(vehicles), 1))
    size = len(population)
    for _ in range(_ROUNDS):
        off = own.acceleration - next_second(fitted[driver], own)
        steps = fitted[driver][:, None, :] + _STEP * np.eye(size)
        slopes = np.stack(
            [next_second(steps[:, k], own) - next_second(fitted[driver], own) for k in range(size)],
            axis=1,
        )
        slopes /= _STEP
        curvature = np.tile(np.eye(size) / spread**2, (len(vehicles), 1, 1))
        np.add.at(curvature, driver, slopes[:, :, None] * slopes[:, None, :] / error**2)
        pull = (population - fitted) / spread**2
        np.add.at(pull, driver, slopes * off[:, None] / error**2)
        fitted = np.clip(fitted + np.linalg.solve(curvature, pull[..., None])[..., 0], LOW, HIGH)
    return dict(zip(vehicles.tolist(), fitted, strict=True))


def of_drivers(
    population: Float64[np.ndarray, " parameter"],
    drivers: dict[int, Float64[np.ndarray, " parameter"]],
    seen: Situations,
) -> Float64[np.ndarray, "moment parameter"]:
    """Return the log-parameters of each moment's driver; the population's of an unknown one."""
    rows = [drivers.get(vehicle, population) for vehicle in seen.vehicle.tolist()]
    return np.array(rows).reshape(len(seen), len(population))


def best_spread(
    population: Float64[np.ndarray, " parameter"],
    train: Situations,
    first: Bool[np.ndarray, " moment"],
    error: float,
) -> float:
    """Return the spread with which first halves of training drivers predict second halves best.

    Args:
        population: Its log-parameters.
        train: Moments of training drivers.
        first: Whether each is of a first half.
        error: Standard deviation of the accelerations, m/s².
    """
    later = train.rows(~first)

    def missed(spread: float) -> float:
        drivers = fit_drivers(population, train.rows(first), error, spread)
        off = next_second(of_drivers(population, drivers, later), later) - later.acceleration
        return float(np.abs(off).sum())

    return min(SPREADS, key=missed)
