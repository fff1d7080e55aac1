"""Angles compatible with the behaviour: those at which its regret is within the margin.

The answer is a set, since many angles share one optimal policy. It is empty if the policy is good
at no angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from socialiq.audit.verdict.regret import Regrets
from socialiq.social.arcs import Arc, arcs_of_grid, complement

_STEP = 1.0  # degrees of the band's grid

_FINE = 0.1  # degrees of the search for the least regret


@dataclass(frozen=True)
class CompatibleAngles:
    """Angles at which the policy's regret is within the margin.

    Attributes:
        arcs: By the estimates.
        surely: Those at which the policy would pass, to the degree: at any angle whose true regret
            exceeds the margin the chance to lie in it is at most `pass_error`.
        possibly: Those at which it would not fail: at any angle whose true regret is within the
            margin the chance to lie outside is at most `fail_error`.
        least_angle: Where the regret is least (the first such), degrees.
        least: The regret there, reward per episode.
        margin: Reward per episode.
    """

    arcs: tuple[Arc, ...]
    surely: tuple[Arc, ...]
    possibly: tuple[Arc, ...]
    least_angle: float
    least: float
    margin: float


def compatible_angles(
    regrets: Regrets, margin: float, pass_error: float = 0.05, fail_error: float = 0.05
) -> CompatibleAngles:
    """Find the arcs and their bootstrap band.

    Towards reference k the regret is r_k cos(α - φ_k), with (r_k, φ_k) its mean gain in polar
    coordinates, so each reference rules out the open arc φ_k ± arccos(margin / r_k).

    Args:
        regrets: Of the evidence.
        margin: Reward per episode, positive.
        pass_error: Of `surely`, at each angle.
        fail_error: Of `possibly`, at each angle.
    """
    env, social = regrets.moments.mean.T
    length = np.hypot(env, social)
    beyond = length > margin
    centres = np.degrees(np.arctan2(social[beyond], env[beyond]))
    halves = np.degrees(np.arccos(margin / length[beyond]))
    grid = np.arange(0.0, 360.0, _STEP).tolist()
    band = [regrets.band(angle, margin, pass_error, fail_error) for angle in grid]
    within, beyond_it = np.array(band).T
    fine = np.deg2rad(np.arange(0.0, 360.0, _FINE))
    by_angle = np.max(env[:, None] * np.cos(fine) + social[:, None] * np.sin(fine), axis=0)
    return CompatibleAngles(
        arcs=complement(centres.tolist(), halves.tolist()),
        surely=arcs_of_grid(within, _STEP),
        possibly=arcs_of_grid(~beyond_it, _STEP),
        least_angle=round(int(by_angle.argmin()) * _FINE, 6),
        least=float(by_angle.min()),
        margin=margin,
    )
