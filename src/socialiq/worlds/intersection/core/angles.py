"""Angles: wrapping, and trigonometric functions with a fast path for tiny arguments.

Most vehicles drive straight along the centre of a lane, so most angles are rounding errors. Below
1e-9 the sine, tangent and their inverses round to the argument itself, in libm too.
"""

from __future__ import annotations

import math

from socialiq.worlds.intersection.core.compile import kernel

_SMALL = 1e-9


@kernel
def wrap_to_pi(angle):
    """Return the same direction in [-π, π)."""
    turned = angle + math.pi
    if 0.0 <= turned < 2 * math.pi:
        return turned - math.pi
    return turned % (2 * math.pi) - math.pi


@kernel
def sin(angle):
    """Return the sine of an angle in rad."""
    return angle if abs(angle) < _SMALL else math.sin(angle)


@kernel
def tan(angle):
    """Return the tangent of an angle in rad."""
    return angle if abs(angle) < _SMALL else math.tan(angle)


@kernel
def asin(value):
    """Return the arcsine in rad."""
    return value if abs(value) < _SMALL else math.asin(value)


@kernel
def atan(value):
    """Return the arctangent in rad."""
    return value if abs(value) < _SMALL else math.atan(value)
