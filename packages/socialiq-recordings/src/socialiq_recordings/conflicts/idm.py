"""Intelligent driver model (IDM), for what a recorded driver would have done otherwise."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from socialiq.errors import UserError


@dataclass(frozen=True)
class Idm:
    """Parameters of the IDM; by default those of Treiber and Kesting (2013, table 11.2) in cities.

    Attributes:
        desired_speed: v0, m/s.
        time_headway: T, s.
        jam_distance: s0, m, bumper to bumper.
        max_acceleration: a, m/s².
        comfort_deceleration: b, m/s², positive.
        exponent: δ.
        hardest: m/s²; no deceleration is harder.
    """

    desired_speed: float = 15.0
    time_headway: float = 1.0
    jam_distance: float = 2.0
    max_acceleration: float = 1.0
    comfort_deceleration: float = 1.5
    exponent: float = 4.0
    hardest: float = 8.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (math.isfinite(value) and value > 0):
                raise UserError(f"{one.name} must be a number above 0, got {value}")


def acceleration(driver: Idm, speed: float, gap: float, leader_speed: float) -> float:
    """Return the acceleration of the IDM, m/s² (Treiber, Hennecke and Helbing 2000, eqs 3, 4).

    a (1 - (v/v0)^δ - (s*/s)²) with s* = s0 + max(0, v T + v (v - v_l) / (2 sqrt(a b))).

    Args:
        driver: Parameters.
        speed: m/s.
        gap: To the leader's rear, m; infinite without a leader.
        leader_speed: m/s.
    """
    free = 1 - (speed / driver.desired_speed) ** driver.exponent
    if math.isinf(gap):
        return max(driver.max_acceleration * free, -driver.hardest)
    braking = 2 * math.sqrt(driver.max_acceleration * driver.comfort_deceleration)
    following = speed * driver.time_headway + speed * (speed - leader_speed) / braking
    wanted = driver.jam_distance + max(0.0, following)
    interaction = (wanted / max(gap, 0.1)) ** 2
    return max(driver.max_acceleration * (free - interaction), -driver.hardest)


def ballistic(speed: float, rate: float, seconds: float) -> tuple[float, float]:
    """Return the distance driven and the speed after a step of constant acceleration.

    The ballistic update of Treiber and Kesting (2013); a vehicle that comes to a stand stays.

    Args:
        speed: m/s.
        rate: Acceleration, m/s².
        seconds: Duration.
    """
    after = speed + rate * seconds
    if after < 0:
        return speed**2 / (-2 * rate), 0.0
    return (speed + after) / 2 * seconds, after
