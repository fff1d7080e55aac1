"""Driver populations for the real highway-env."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from highway_env.vehicle.behavior import IDMVehicle  # pyright: ignore[reportMissingImports]

from socialiq.worlds.intersection.options import POPULATIONS, Normal, Population


class Driver(IDMVehicle):
    """highway-env's driver with drawn values of the parameters that the population varies.

    A driver with a desired speed enters with it as target. Road rules set the target speed to 0 for
    a yield and to the road's limit after it. The target speed is therefore bounded by the desired
    speed, so that the preference is kept. Subclasses name the population.
    """

    population: ClassVar[Population] = POPULATIONS["highway_env"]
    desired_speed = math.inf  # until the draw, which follows the construction
    _target_speed = 0.0

    @property
    def target_speed(self) -> float:
        """Speed that the driver aims for on a free road, m/s."""
        return self._target_speed

    @target_speed.setter
    def target_speed(self, value: float | int) -> None:
        self._target_speed = min(float(value), self.desired_speed)

    def randomize_behavior(self) -> None:
        """Draw the exponent, then the fields of the population in their order."""
        super().randomize_behavior()
        desired, headway, gap, acceleration, deceleration = (
            _drawn(normal, self.road.np_random) for normal in self.population
        )
        self.TIME_WANTED = headway
        self.DISTANCE_WANTED = gap
        self.COMFORT_ACC_MAX = acceleration
        self.COMFORT_ACC_MIN = -deceleration
        self.desired_speed = desired
        if math.isfinite(desired):
            self.target_speed = desired  # pyright: ignore[reportIncompatibleVariableOverride]


def _drawn(normal: Normal, random: Any) -> float:
    if normal.deviation == 0:
        return normal.mean
    value = normal.mean + normal.deviation * random.normal()
    return min(max(value, normal.low), normal.high)


DRIVERS: dict[str, type] = {"highway_env": IDMVehicle} | {
    name: type(f"Driver_{name}", (Driver,), {"population": population, "__module__": __name__})
    for name, population in POPULATIONS.items()
    if name != "highway_env"
}
"""Class of the other vehicles in each population."""
# highway-env resolves its drivers by dotted path.
globals().update({driver.__name__: driver for driver in DRIVERS.values()})
