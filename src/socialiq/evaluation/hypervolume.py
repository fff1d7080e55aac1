"""The hypervolume of a family of policies: how much of the two rewards' plane it covers."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError


def hypervolume(
    points: Float[np.ndarray, "policy 2"], reference: Float[np.ndarray, " xy"]
) -> float:
    """Area of what at least one policy dominates (Zitzler and Thiele 1999).

    Args:
        points: Mean totals (R_env, R_social), more is better.
        reference: The corner that bounds the area below; points that don't beat it in both
            count for nothing. Areas compare only under one reference.

    Returns:
        The area, in units of R_env times units of R_social.

    Raises:
        UserError: If a number is not finite.
    """
    if not (np.isfinite(points).all() and np.isfinite(reference).all()):
        raise UserError("a hypervolume needs finite points: leave out policies without totals")
    above = points[(points > reference).all(axis=1)] - reference
    area, height = 0.0, 0.0
    for env, social in above[np.argsort(-above[:, 0])]:
        # From the right, each point adds the strip by which it is higher than all before it.
        area += env * max(social - height, 0.0)
        height = max(height, social)
    return float(area)
