"""Physics of vehicles: angles, car-following, constant acceleration, rectangles.

Each function is the one source of two forms: of numbers or NumPy arrays that fit each other, and of
numbers in compiled kernels, where `worlds.highway.core.compile` makes it callable. It therefore has
no branches. A caller adds its own limits, and the powers whose rounding its results depend on.
"""

from __future__ import annotations

import math
from typing import Any, no_type_check

import numpy as np


@no_type_check
def wrapped(angle: Any, half_turn: Any = math.pi) -> Any:
    """Return the same direction in [-half_turn, half_turn).

    Args:
        angle: Angle, in rad or in degrees.
        half_turn: Half a turn in the unit of the angle: π for rad, 180 for degrees.
    """
    return (angle + half_turn) % (2 * half_turn) - half_turn


def wrapped_heading(angle: np.ndarray) -> np.ndarray:
    """Return the same directions in (-π, π]; an angle in this range keeps its bits."""
    outside = (angle <= -np.pi) | (angle > np.pi)
    return np.where(outside, -wrapped(-angle), angle)


@no_type_check
def desired_gap(steady: Any, speed: Any, closing: Any, strongest: Any, comfort: Any) -> Any:
    """Return the gap that the Intelligent Driver Model wants, m.

    The gap is s + v Δv / (2 sqrt(a b)) (Treiber, Hennecke and Helbing 2000, eq 4).

    Args:
        steady: Gap s at equal speeds, m: s0 + v T, or v T alone, to which the caller adds s0 beyond
            its limit.
        speed: Speed v of the follower, m/s.
        closing: Speed Δv at which the follower approaches the leader, m/s.
        strongest: Largest acceleration a, m/s², positive.
        comfort: Comfortable deceleration b, m/s², positive.
    """
    return steady + speed * closing / (2.0 * np.sqrt(strongest * comfort))


@no_type_check
def idm(free: Any, ratio: Any, strongest: Any) -> Any:
    """Return the acceleration of the Intelligent Driver Model, m/s² (the same source, eq 3).

    The acceleration is a (f - (s*/s)²). The compiled roads subtract two products, as highway-env
    does; see `core.vehicle.braking_for`.

    Args:
        free: Term f of the free road, 1 - (v/v0)^δ.
        ratio: Ratio of the desired gap to the gap, s*/s.
        strongest: Largest acceleration a, m/s².
    """
    return strongest * (free - ratio * ratio)


@no_type_check
def ballistic(speed: Any, rate: Any, seconds: Any) -> Any:
    """Return the distance driven, m, and the speed after a step of constant acceleration, m/s.

    The ballistic update of Treiber and Kesting (2013); a vehicle that comes to a stand stays.

    Args:
        speed: Speed before the step, m/s.
        rate: Acceleration, m/s²; negative for braking.
        seconds: Duration of the step, s.
    """
    after = speed + rate * seconds
    stops = after < 0.0
    until_stand = speed * speed / (-2.0 * (stops * rate - (1.0 - stops)))
    driven = stops * until_stand + (1.0 - stops) * ((speed + after) / 2.0 * seconds)
    return driven, np.maximum(after, 0.0)


@no_type_check
def overlap_depth(
    dx: Any, dy: Any, heading: Any, other_heading: Any,
    length: Any, width: Any, other_length: Any, other_width: Any,
) -> Any:  # fmt: skip
    """Return the smallest displacement that separates two rectangles, m; negative if disjoint.

    Two rectangles are disjoint exactly if an axis along a side of one of them separates them
    (Gottschalk, Lin and Manocha, SIGGRAPH 1996).

    Args:
        dx: Offset along x of the second rectangle's middle from the first one's, m.
        dy: Offset along y of the second rectangle's middle from the first one's, m.
        heading: Heading of the first rectangle, rad.
        other_heading: Heading of the second rectangle, rad.
        length: Half the length of the first rectangle, m.
        width: Half the width of the first rectangle, m.
        other_length: Half the length of the second rectangle, m.
        other_width: Half the width of the second rectangle, m.
    """
    turned = other_heading - heading
    cos = abs(np.cos(turned))
    sin = abs(np.sin(turned))
    east = np.cos(heading)
    north = np.sin(heading)
    along = length + other_length * cos + other_width * sin - abs(dx * east + dy * north)
    across = width + other_length * sin + other_width * cos - abs(dy * east - dx * north)
    depth = np.minimum(along, across)
    east = np.cos(other_heading)
    north = np.sin(other_heading)
    along = other_length + length * cos + width * sin - abs(dx * east + dy * north)
    across = other_width + length * sin + width * cos - abs(dy * east - dx * north)
    return np.minimum(depth, np.minimum(along, across))


def corners(middle: Any, heading: float, length: float, width: float) -> np.ndarray:
    """Return the corners of a rectangle, in order around it.

    Args:
        middle: Middle of the rectangle, (x, y) in m.
        heading: Heading in rad.
        length: Length along the heading, m.
        width: Width across the heading, m.

    Returns:
        Shape (4, 2), in m. The first two corners are at the front.
    """
    ahead = np.array([math.cos(heading), math.sin(heading)]) * length / 2
    left = np.array([-math.sin(heading), math.cos(heading)]) * width / 2
    return middle + np.array([ahead + left, ahead - left, -ahead - left, left - ahead])
