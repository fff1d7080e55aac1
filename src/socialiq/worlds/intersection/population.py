"""Named populations of Intelligent Driver Model parameters of the other drivers."""

from __future__ import annotations

from typing import NamedTuple


class Normal(NamedTuple):
    """Normal distribution whose draws are clipped to an interval."""

    mean: float
    deviation: float
    low: float
    high: float


class Population(NamedTuple):
    """Distributions that a driver draws from when it enters, in the order of the fields.

    The exponent of the free-road term is always drawn first, uniformly from 3.5 to 4.5, as
    highway-env does. A field with deviation 0 draws nothing.

    Attributes:
        desired_speed: m/s. Infinite: the driver starts with the speed it enters at, and takes the
            road's limit after its first yield, as in highway-env.
        time_headway: s.
        jam_distance: m.
        max_acceleration: m/s².
        comfort_deceleration: m/s², positive.
    """

    desired_speed: Normal
    time_headway: Normal
    jam_distance: Normal
    max_acceleration: Normal
    comfort_deceleration: Normal


def _fixed(value: float) -> Normal:
    return Normal(value, 0.0, value, value)


POPULATIONS = {
    "highway_env": Population(
        desired_speed=_fixed(float("inf")),
        time_headway=_fixed(1.5),
        jam_distance=_fixed(7.0),
        max_acceleration=_fixed(6.0),
        comfort_deceleration=_fixed(3.0),
    ),
    "thesis": Population(
        desired_speed=Normal(8.0, 1.0, 5.0, 10.0),
        time_headway=Normal(1.5, 0.4, 0.5, 2.5),
        jam_distance=Normal(7.0, 1.5, 3.0, 11.0),
        max_acceleration=Normal(6.0, 1.0, 3.0, 9.0),
        comfort_deceleration=Normal(3.0, 0.5, 1.5, 4.5),
    ),
}
"""Populations: `highway_env` as in the real environment, `thesis` as described in 5.1.3.

The thesis prints no distribution. Those of `thesis` are centred on highway-env's values, with
spreads of the size that calibrations of the model report, and clipped to physical values.
"""
