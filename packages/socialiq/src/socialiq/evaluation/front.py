"""Families of policies in the plane of the two rewards: the best at each angle, hypervolume.

A policy's mean totals are a point, and J(α) = cos α · R_env + sin α · R_social is the point's
extent along the normal at α. A policy is the best of all at the angles whose normal is in the
normal cone of its vertex of the convex hull, and at no angle if it is not a vertex.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError

_NO_POINTS = "at least one policy is needed, and finite mean totals of each"
_NARROWEST = 1e-9  # degrees; below it a point is on an edge, up to rounding


def support_intervals(
    points: Mapping[str, Sequence[float]],
) -> dict[str, tuple[float, float] | None]:
    """Return the angles at which each policy is the best of all.

    The directions to all other points leave a gap; one wider than 180 degrees makes the point a
    vertex, and its normals are at 90 degrees or more from them.

    Args:
        points: Mean totals (R_env, R_social) by name.

    Returns:
        (low, high) in degrees, low in (-180, 180] and high up to 360 more, so an arc through 180
        stays whole. None for a policy that is the best at no angle, or only ties with the ends of
        its edge. Equal points have equal intervals; if all are equal, (-180, 180).

    Raises:
        UserError: If there is no point or one is not finite.
    """
    array = np.array(list(points.values()), np.float64).reshape(len(points), 2)
    if not len(array) or not np.isfinite(array).all():
        raise UserError(_NO_POINTS)
    intervals: dict[str, tuple[float, float] | None] = {}
    for name, point in zip(points, array, strict=True):
        offsets = array - point
        offsets = offsets[offsets.any(axis=1)]
        if not len(offsets):
            intervals[name] = (-180.0, 180.0)
            continue
        directions = np.sort(np.degrees(np.arctan2(offsets[:, 1], offsets[:, 0])))
        gaps = np.diff(directions, append=directions[0] + 360.0)
        widest = int(gaps.argmax())
        width = float(gaps[widest]) - 180.0
        low = float(directions[widest]) + 90.0
        low -= 360.0 if low > 180.0 else 0.0
        intervals[name] = None if width <= _NARROWEST else (low, low + width)
    return intervals


def hypervolume(
    points: Float[np.ndarray, "policy 2"], reference: Float[np.ndarray, " xy"]
) -> float:
    """Return the area dominated by at least one policy (Zitzler and Thiele 1999).

    Args:
        points: Mean totals (R_env, R_social), more is better.
        reference: Corner that bounds the area below; points that don't exceed it in both
            are ignored. Areas are comparable only with the same reference.

    Raises:
        UserError: If a number is not finite.
    """
    if not (np.isfinite(points).all() and np.isfinite(reference).all()):
        raise UserError("a hypervolume needs finite points: leave out policies without totals")
    above = points[(points > reference).all(axis=1)] - reference
    area = 0.0
    height = 0.0
    for env, social in above[np.argsort(-above[:, 0])]:
        # From the right, each point adds the strip by which it exceeds all before it.
        area += env * max(social - height, 0.0)
        height = max(height, social)
    return float(area)
