"""Stated errors of measurement, and the tolerances that follow from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from socialiq.errors import UserError

COVERAGE = 3.0
"""Standard errors that a difference may be before it is taken as an error of the file; three hold
99.7 % of normal differences (JCGM 100:2008, G.3)."""

_TURNING = 14.0
"""Degrees; angle between heading and motion of the middle of a car of 5 m that turns with a radius
of 6 m, whose rear axle moves along the heading: atan(1.5 / 6)."""


@dataclass(frozen=True)
class MeasurementError:
    """Standard errors of a source's measurement; the defaults are assumed where it states none.

    Attributes:
        position: m, in each direction, independent from frame to frame (the worst case).
        speed: m/s.
        heading: Degrees.
        size: m, of length and width.
        scale: Relative, of distances: a camera's picture is not equally large everywhere.

    Raises:
        UserError: If one is not a number above 0.
    """

    position: float = 0.25
    speed: float = 0.25
    heading: float = 2.0
    size: float = 0.2
    scale: float = 0.05

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 < value < math.inf:
                raise UserError(f"error of {field.name} must be a number above 0, got {value:g}")

    def mean_speed(self, seconds: float, driven: float) -> float:
        """Return the largest difference of driven and stated mean speed over a time, m/s.

        The driven distance is a difference of two positions.

        Args:
            seconds: The time.
            driven: Driven speed, m/s.
        """
        positions = math.sqrt(2.0) * self.position / seconds
        return COVERAGE * math.hypot(self.speed, positions, self.scale * driven)

    def jump(self, dt: float) -> float:
        """Return the largest excess of a displacement between frames over the stated, m."""
        return COVERAGE * math.hypot(math.sqrt(2.0) * self.position, self.speed * dt)

    @property
    def direction(self) -> float:
        """Largest angle between heading and motion, rad."""
        return math.radians(_TURNING + COVERAGE * self.heading)

    @property
    def overlap(self) -> float:
        """Largest depth by which two boxes overlap although the vehicles do not touch, m.

        The depth is a difference of two positions, less half a side of each box.
        """
        return COVERAGE * math.hypot(math.sqrt(2.0) * self.position, self.size / math.sqrt(2.0))
