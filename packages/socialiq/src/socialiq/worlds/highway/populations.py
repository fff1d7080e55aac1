"""Populations of drivers: distributions of the parameters that a driver draws when it enters."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple


class Driver(NamedTuple):
    """highway-env's driver of a road, and the speed limit where the ego enters."""

    speed_limit: float  # m/s
    time_headway: float  # s
    jam_distance: float  # m
    max_acceleration: float  # m/s²
    comfort_deceleration: float  # m/s², positive


class Normal(NamedTuple):
    """Normal distribution whose draws are clipped to an interval."""

    mean: float
    deviation: float
    low: float
    high: float

    def times(self, scale: float) -> Normal:
        """Return the distribution of the scaled quantity."""
        return Normal(*(value * scale for value in self))


class Population(NamedTuple):
    """Distributions that a driver draws from when it enters, in the order of the fields.

    A road that draws the exponent of the free-road term, as the intersection does for each driver,
    draws it first, uniformly from 3.5 to 4.5 as highway-env. No number is drawn for a field with
    deviation 0.
    """

    # m/s. Infinite: the driver starts with the speed it enters at, and takes the road's limit after
    # its first yield, as in highway-env
    desired_speed: Normal
    time_headway: Normal  # s
    jam_distance: Normal  # m
    max_acceleration: Normal  # m/s²
    comfort_deceleration: Normal  # m/s², positive

    def of(self, driver: Driver) -> Population:
        """Return the population whose fields are these multiples of a driver's."""
        fields = zip(self, driver, strict=True)
        return Population(*(field.times(scale) for field, scale in fields))


def _constant(*multiples: float) -> Population:
    return Population(*(Normal(value, 0.0, value, value) for value in multiples))


Name = Literal["highway_env", "thesis", "wet"]

MULTIPLES: dict[Name, Population] = {
    "highway_env": _constant(math.inf, 1.0, 1.0, 1.0, 1.0),
    "thesis": Population(
        desired_speed=Normal(0.8, 0.1, 0.5, 1.0),
        time_headway=Normal(1.0, 0.4 / 1.5, 0.5 / 1.5, 2.5 / 1.5),
        jam_distance=Normal(1.0, 1.5 / 7.0, 3.0 / 7.0, 11.0 / 7.0),
        max_acceleration=Normal(1.0, 1.0 / 6.0, 3.0 / 6.0, 9.0 / 6.0),
        comfort_deceleration=Normal(1.0, 0.5 / 3.0, 1.5 / 3.0, 4.5 / 3.0),
    ),
    "wet": _constant(math.inf, 1.0, 1.0, 0.5, 0.5),
}
"""Populations as multiples of the road's driver: `highway_env` is this driver, `thesis` draws as
described in 5.1.3, and `wet` has half of its accelerations.

The thesis prints no distribution. Those of `thesis` are centred on highway-env's values, with
spreads of the size that calibrations of the model report, and clipped to physical values.
"""
