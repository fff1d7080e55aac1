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
    """Return the same direction in [-half_turn, half_turn): in rad, or in degrees with 180."""
    return (angle + half_turn) % (2 * half_turn) - half_turn


def wrapped_heading(angle: np.ndarray) -> np.ndarray:
    """Return the same directions in (-π, π]; an angle in this range keeps its bits."""
    outside = (angle <= -np.pi) | (angle > np.pi)
    return np.where(outside, -wrapped(-angle), angle)


@no_type_check
def desired_gap(steady: Any, speed: Any, closing: Any, strongest: Any, comfort: Any) -> Any:
    """Return the gap that the Intelligent Driver Model wants, m.

    s + v Δv / (2 sqrt(a b)) (Treiber, Hennecke and Helbing 2000, eq 4). `steady` is the gap s at
    equal speeds: s0 + v T, or v T alone, to which the caller adds s0 beyond its limit. Speeds in
    m/s, accelerations in m/s², both positive.
    """
    return steady + speed * closing / (2.0 * np.sqrt(strongest * comfort))


@no_type_check
def idm(free: Any, ratio: Any, strongest: Any) -> Any:
    """Return the acceleration of the Intelligent Driver Model, m/s² (the same source, eq 3).

    a (f - (s*/s)²) with f = 1 - (v/v0)^δ, and the ratio of the desired gap to the gap, s*/s. The
    compiled roads subtract two products, as highway-env does; see `core.vehicle.braking_for`.
    """
    return strongest * (free - ratio * ratio)


@no_type_check
def ballistic(speed: Any, rate: Any, seconds: Any) -> Any:
    """Return the distance driven, m, and the speed after a step of constant acceleration, m/s.

    The ballistic update of Treiber and Kesting (2013); a vehicle that comes to a stand stays.
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
    (Gottschalk, Lin and Manocha, SIGGRAPH 1996). The other's middle is dx, dy from the first one's,
    m; lengths and widths are halves, m; headings in rad.
    """
    turned = other_heading - heading
    cos, sin = abs(np.cos(turned)), abs(np.sin(turned))
    east, north = np.cos(heading), np.sin(heading)
    along = length + other_length * cos + other_width * sin - abs(dx * east + dy * north)
    across = width + other_length * sin + other_width * cos - abs(dy * east - dx * north)
    depth = np.minimum(along, across)
    east, north = np.cos(other_heading), np.sin(other_heading)
    along = other_length + length * cos + width * sin - abs(dx * east + dy * north)
    across = other_width + length * sin + width * cos - abs(dy * east - dx * north)
    return np.minimum(depth, np.minimum(along, across))


def corners(middle: Any, heading: float, length: float, width: float) -> np.ndarray:
    """Return the corners of a rectangle, (4, 2) in m, in order around it; heading in rad."""
    ahead = np.array([math.cos(heading), math.sin(heading)]) * length / 2
    left = np.array([-math.sin(heading), math.cos(heading)]) * width / 2
    return middle + np.array([ahead + left, ahead - left, -ahead - left, left - ahead])
