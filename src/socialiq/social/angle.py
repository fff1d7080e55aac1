"""The social angle: checked degrees in, weights out, and the angle that behaviour shows."""

from __future__ import annotations

import math

import numpy as np

from socialiq.errors import UserError
from socialiq.types import RewardPair


def check_angle(angle: float) -> float:
    """Return a social angle in degrees if it lies in [0, 360), the range of thesis 4.2.

    Raises:
        UserError: If it is not finite or lies outside.
    """
    if not math.isfinite(angle) or not 0.0 <= angle < 360.0:
        raise UserError(f"angle {angle:g} is outside [0, 360) degrees: 0 egoistic, 90 altruistic")
    return float(angle)


def weights(angle: float) -> RewardPair:
    """Weights (cos α, sin α) of an angle in degrees (Eq 4.3).

    cos 90° is the float64 6.1e-17, not 0. The thesis' altruistic expert of the 5x5 world depends
    on that residue (docs/worlds/crossing5.md), so it is kept; `exact_weights` has the zeros.
    """
    radians = np.deg2rad(angle)
    return RewardPair(env=float(np.cos(radians)), social=float(np.sin(radians)))


def exact_weights(angle: float) -> RewardPair:
    """Weights (cos α, sin α), with exact zeros and ones at multiples of 90 degrees."""
    env, social = weights(angle)
    if angle % 90 == 0:
        return RewardPair(env=float(round(env)), social=float(round(social)))
    return RewardPair(env=env, social=social)


def angle_of(env: float, social: float) -> float:
    """α̂ = atan2(R_social, R_env) in degrees, in (-180, 180] (thesis 5.4).

    Pass means over episodes: an angle of means, never a mean of angles.
    """
    degrees = math.degrees(math.atan2(social, env))
    # atan2 gives -180 for a social return of -0.0, or for one too small to show.
    return 180.0 if degrees == -180.0 else degrees


def angle_difference(a: float, b: float) -> float:
    """The signed difference a - b of two angles in degrees, wrapped to [-180, 180)."""
    wrapped = (a - b + 180.0) % 360.0 - 180.0
    # The remainder of a very small negative number rounds up to 360.
    return -180.0 if wrapped == 180.0 else wrapped
