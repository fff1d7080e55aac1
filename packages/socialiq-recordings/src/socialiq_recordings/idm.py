"""Intelligent driver model (IDM) over arrays, and steps of constant acceleration."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64


class Idm(NamedTuple):
    """Parameters of the IDM; by default those of Treiber and Kesting (2013, table 11.2) in cities.

    Attributes:
        desired_speed: v0, m/s.
        time_headway: T, s.
        jam_distance: s0, m, bumper to bumper.
        max_acceleration: a, m/s².
        comfort_deceleration: b, m/s², positive.
    """

    desired_speed: float = 15.0
    time_headway: float = 1.0
    jam_distance: float = 2.0
    max_acceleration: float = 1.0
    comfort_deceleration: float = 1.5


EXPONENT = 4.0
"""δ."""

HARDEST = 8.0
"""m/s²; no deceleration is harder."""


def acceleration(
    speed: Any,
    gap: Any,
    leader_speed: Any,
    desired: Any,
    headway: Any,
    jam: Any,
    strongest: Any,
    comfort: Any,
) -> Any:
    """Return the acceleration of the IDM, m/s² (Treiber, Hennecke and Helbing 2000, eqs 3, 4).

    a (1 - (v/v0)^δ - (s*/s)²) with s* = s0 + max(0, v T + v (v - v_l) / (2 sqrt(a b))). All
    arguments are numbers or arrays that fit each other; `world.traffic.idm` is the compiled form.

    Args:
        speed: v, m/s.
        gap: s, to the leader's rear, m; infinite without a leader.
        leader_speed: v_l, m/s.
        desired: v0, m/s.
        headway: T, s.
        jam: s0, m.
        strongest: a, m/s².
        comfort: b, m/s².
    """
    closing = speed * (speed - leader_speed) / (2 * np.sqrt(strongest * comfort))
    keeps = jam + np.maximum(0.0, speed * headway + closing)
    free = 1 - (speed / desired) ** EXPONENT
    rate = strongest * (free - (keeps / np.maximum(gap, 0.1)) ** 2)
    return np.maximum(rate, -HARDEST)


def ballistic(
    speed: Float64[np.ndarray, "*shape"], rate: Float64[np.ndarray, "*shape"], seconds: float
) -> tuple[Float64[np.ndarray, "*shape"], Float64[np.ndarray, "*shape"]]:
    """Return the distances driven and the speeds after a step of constant acceleration.

    The ballistic update of Treiber and Kesting (2013); a vehicle that comes to a stand stays.

    Args:
        speed: m/s.
        rate: Acceleration, m/s².
        seconds: Duration.
    """
    after = speed + rate * seconds
    stops = after < 0
    until_stand = speed**2 / (-2 * np.where(stops, rate, -1.0))
    driven = np.where(stops, until_stand, (speed + after) / 2 * seconds)
    return driven, np.maximum(after, 0.0)
