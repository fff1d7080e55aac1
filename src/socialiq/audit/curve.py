"""The reference curve: which α̂ a driver made for an angle shows, and the way back.

α̂ = atan2(R_social, R_env) of the best policy for an angle is not that angle (docs/theory.md), so
α̂ of a policy under audit is read off the curve of drivers whose angle is known.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64

from socialiq.audit.outcomes import Outcomes

_DECIMALS = 6  # of an angle: neighbouring intervals share their ends but for rounding
_LEVEL = 1e-9  # degrees; α̂ that differ less are equal but for rounding


class Points(NamedTuple):
    """Points of the curve, in the order of their angles.

    Attributes:
        angle: In degrees, unwrapped: it rises along the curve.
        driver: Which reference each belongs to.
    """

    angle: Float[np.ndarray, " point"]
    driver: Int64[np.ndarray, " point"]


class Preimage(NamedTuple):
    """Angles at which the curve shows some α̂: the hull of all of them, by resample.

    Attributes:
        low: Smallest angle, degrees; the nearest end of the curve if α̂ is beyond it.
        high: Largest angle.
        beyond: Whether no point of the curve shows this α̂.
    """

    low: Float[np.ndarray, " resample"]
    high: Float[np.ndarray, " resample"]
    beyond: np.ndarray


def points_of(references: tuple[Outcomes, ...], declared: float) -> Points:
    """The curve over the quadrant of the declared angle.

    Further round, other quadrants show the same α̂ for other trade-offs. A reference that is
    optimal over an interval gives its two ends, between which the curve is flat.

    Args:
        references: Those without an angle are left out.
        declared: Angle in degrees.
    """
    first = 90.0 * max(0, math.ceil(declared / 90.0) - 1)  # 90 is the end of the first
    rows: list[tuple[float, float, int]] = []
    for number, one in enumerate(references):
        for turn in (-360.0, 0.0, 360.0) if one.angles else ():
            low, high = (round(end + turn, _DECIMALS) for end in (one.angles[0], one.angles[-1]))
            clipped = {max(low, first), min(high, first + 90.0)}
            if max(low, first) <= min(high, first + 90.0):
                rows += [(angle, (low + high) / 2, number) for angle in sorted(clipped)]
    rows.sort()
    return Points(
        np.array([angle for angle, _, _ in rows], np.float64),
        np.array([number for _, _, number in rows], np.int64),
    )


def preimage(
    angle: Float[np.ndarray, " point"],
    shown: Float[np.ndarray, "resample point"],
    sought: Float[np.ndarray, " resample"],
) -> Preimage:
    """Invert the curve, taken as straight lines between its points.

    Where it is flat at the height sought, the whole flat piece is the answer; where it turns back,
    the hull of all answers is.

    Args:
        angle: Of the points, rising, at least two.
        shown: α̂ of the points, unwrapped along the curve.
        sought: α̂ to look up, unwrapped likewise.
    """
    low = np.full(len(sought), np.inf)
    high = np.full(len(sought), -np.inf)
    for left in range(len(angle) - 1):
        y, z = shown[:, left], shown[:, left + 1]
        inside = (np.minimum(y, z) - _LEVEL <= sought) & (sought <= np.maximum(y, z) + _LEVEL)
        flat = np.abs(z - y) <= _LEVEL
        way = np.divide(sought - y, z - y, out=np.zeros_like(y), where=~flat).clip(0.0, 1.0)
        at = angle[left] + way * (angle[left + 1] - angle[left])
        low = np.minimum(low, np.where(inside, np.where(flat, angle[left], at), np.inf))
        high = np.maximum(high, np.where(inside, np.where(flat, angle[left + 1], at), -np.inf))
    beyond = np.isinf(low)
    nearest = np.abs(shown - sought[:, None]).argmin(axis=1)
    low = np.where(beyond, angle[nearest], low)
    return Preimage(low, np.where(beyond, angle[nearest], high), beyond)
