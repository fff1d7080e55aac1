"""Cohen's d: how far apart two groups' totals lie (thesis A.2)."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError


def cohens_d(first: Float[np.ndarray, " m"], second: Float[np.ndarray, " n"]) -> float:
    """(mean of first - mean of second) / pooled standard deviation (thesis A.2).

    Args:
        first: One group's values, at least two.
        second: The other's, at least two.

    Returns:
        d; infinite, with the sign of the difference, where both groups are constant and differ,
        and 0 where they are constant and equal.

    Raises:
        UserError: If a group has fewer than two values.
    """
    if min(len(first), len(second)) < 2:
        raise UserError("Cohen's d needs at least two values in each group")
    degrees = len(first) + len(second) - 2
    squares = (len(first) - 1) * first.var(ddof=1) + (len(second) - 1) * second.var(ddof=1)
    difference = float(first.mean() - second.mean())
    spread = math.sqrt(squares / degrees)
    if spread < 1e-12:
        return 0.0 if abs(difference) < 1e-12 else math.copysign(math.inf, difference)
    return difference / spread
