"""Angles: wrapping, and functions that are quick where the answer is their argument.

Most vehicles drive straight on the middle of a lane, so most angles are rounding errors. Below
1e-9 the sine, tangent and their inverses round to the argument itself, in libm too.
"""

from __future__ import annotations

import math

from socialiq.worlds.intersection.core.compile import kernel

_SMALL = 1e-9


@kernel
def wrap_to_pi(angle):
    """The same direction, from -π up to π."""
    turned = angle + math.pi
    if 0.0 <= turned < 2 * math.pi:
        return turned - math.pi
    return turned % (2 * math.pi) - math.pi


@kernel
def sin(angle):
    """Sine."""
    return angle if abs(angle) < _SMALL else math.sin(angle)


@kernel
def tan(angle):
    """Tangent."""
    return angle if abs(angle) < _SMALL else math.tan(angle)


@kernel
def asin(value):
    """Angle whose sine this is."""
    return value if abs(value) < _SMALL else math.asin(value)


@kernel
def atan(value):
    """Angle whose tangent this is."""
    return value if abs(value) < _SMALL else math.atan(value)
