"""The Intelligent Driver Model of recorded traffic: its parameters, its limits, its calibration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float64
from scipy.optimize import least_squares

from socialiq.physics import desired_gap, idm


class Idm(NamedTuple):
    """IDM parameters; by default of Treiber and Kesting (2013, table 11.2), in cities."""

    desired_speed: float = 15.0  # v0, m/s
    time_headway: float = 1.0  # T, s
    jam_distance: float = 2.0  # s0, m, bumper to bumper
    max_acceleration: float = 1.0  # a, m/s²
    comfort_deceleration: float = 1.5  # b, m/s², positive


EXPONENT = 4.0  # δ
HARDEST = 8.0  # m/s²; no deceleration is harder
_LEAST_GAP = 0.1  # m


def acceleration(
    speed: Any, gap: Any, leader_speed: Any, desired: Any,
    headway: Any, jam: Any, strongest: Any, comfort: Any,
) -> Any:  # fmt: skip
    """Return the acceleration of the IDM, m/s² (`physics.idm`), of numbers or arrays.

    Args:
        speed: Speed of the follower, m/s.
        gap: Distance to the leader's rear, m; infinite without a leader.
        leader_speed: Speed of the leader, m/s.
        desired: Desired speed v0, m/s.
        headway: Time headway T, s.
        jam: Jam distance s0, m.
        strongest: Largest acceleration a, m/s².
        comfort: Comfortable deceleration b, m/s², positive.
    """
    power = (speed / desired) ** EXPONENT
    return limited(speed, gap, leader_speed, power, headway, jam, strongest, comfort)


@no_type_check
def limited(
    speed: Any, gap: Any, leader_speed: Any, power: Any,
    headway: Any, jam: Any, strongest: Any, comfort: Any,
) -> Any:  # fmt: skip
    """Return `acceleration` from (v/v0)^δ, also in `world.traffic`, whose power is a product.

    Its limits: a faster leader shortens the desired gap to the jam distance at most, the gap is at
    least 0.1 m, and no deceleration exceeds `HARDEST`.

    Args:
        speed: Speed of the follower, m/s.
        gap: Distance to the leader's rear, m; infinite without a leader.
        leader_speed: Speed of the leader, m/s.
        power: (v/v0)^δ, with the follower's speed v and its desired speed v0.
        headway: Time headway T, s.
        jam: Jam distance s0, m.
        strongest: Largest acceleration a, m/s².
        comfort: Comfortable deceleration b, m/s², positive.
    """
    wish = desired_gap(speed * headway, speed, speed - leader_speed, strongest, comfort)
    ratio = (jam + np.maximum(0.0, wish)) / np.maximum(gap, _LEAST_GAP)
    return np.maximum(idm(1.0 - power, ratio, strongest), -HARDEST)


def calibrate(
    errors: Callable[[np.ndarray], np.ndarray],
    start: Any,
    bounds: tuple[Any, Any],
    evaluations: int | None = None,
) -> Float64[np.ndarray, " parameter"]:
    """Return the parameters with the least error, of which more than 1 m/s² counts less (soft L1).

    Args:
        errors: Errors in m/s² of an array of parameters. Drivers of a recorded world are fitted to
            the acceleration at a moment, by a and b alone; predictions to the mean acceleration of
            the next second, by the logarithms of all parameters, held near those of the literature.
        start: Parameters that are tried first.
        bounds: The lowest and the highest of each parameter.
        evaluations: Largest number of evaluations; None takes SciPy's.
    """
    fit = least_squares(errors, start, bounds=bounds, loss="soft_l1", max_nfev=evaluations)
    return np.asarray(fit.x)
