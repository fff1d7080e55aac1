"""Norms among drivers who choose their angles: invasion, stable angles, mandated minima (9.4).

A payoff matrix has what a driver of the row's angle gets where everybody else has the column's.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from socialiq.errors import UserError

_STEPS = 20_000
_REGRET = 1e-6


class RestPoint(NamedTuple):
    """State in which no driver gains by another angle that is open to its group."""

    shares: Float[np.ndarray, "group angle"]  # of all drivers
    payoffs: Float[np.ndarray, " group"]  # mean of each group
    regret: float  # the most that a driver would gain still


def invasion_fitness(
    payoffs: Float[np.ndarray, "angle angle"],
) -> Float[np.ndarray, "angle angle"]:
    """Return what few drivers of the row's angle get more than the residents of the column's."""
    return payoffs - np.diagonal(payoffs)


def stable_angles(
    payoffs: Float[np.ndarray, "angle angle"], tolerance: float = 1e-9
) -> Bool[np.ndarray, " angle"]:
    """Return a mask of the angles that are evolutionarily stable (Maynard Smith and Price 1973).

    No few drivers of another angle get more among the residents, and those that get as much get
    less than a resident where the invaders meet each other.

    Args:
        payoffs: Payoff of a driver of the row's angle where all others have the column's.
        tolerance: Largest difference of payoffs that counts as equal.
    """
    uniform = np.diagonal(payoffs)
    loses = invasion_fitness(payoffs) < -tolerance
    ties = np.abs(invasion_fitness(payoffs)) <= tolerance
    holds = loses | (ties & (uniform[:, None] + tolerance < payoffs.T))
    return np.all(holds | np.eye(len(uniform), dtype=bool), axis=0)


def rest_point(
    payoffs: Float[np.ndarray, "angle angle"],
    is_open: Bool[np.ndarray, "group angle"],
    sizes: Sequence[float],
) -> RestPoint:
    """Return where imitation of better drivers ends, from equal shares of the open angles.

    Each group imitates within itself (replicator dynamics), and meets everybody.

    Args:
        payoffs: By own and other's angle.
        is_open: Angles that a group may choose.
        sizes: Share of each group among all drivers; they add up to 1.

    Raises:
        UserError: If a group has no angle, or the dynamics do not come to rest.
    """
    if not is_open.any(axis=1).all():
        raise UserError("a group may choose no angle: lower the minimum")
    present = np.array(sizes) > 0.0
    shares = is_open / is_open.sum(axis=1, keepdims=True) * np.array(sizes)[:, None]
    scale = max(float(np.ptp(payoffs)), 1e-12)
    for step in range(_STEPS):
        expected = payoffs @ shares.sum(axis=0)
        if step % 100 == 0:
            sums = shares.sum(axis=1)
            means = shares @ expected / np.where(sums > 0.0, sums, 1.0)
            gains = np.where(is_open[present], expected - means[present, None], -np.inf)
            if gains.max() < _REGRET * scale:
                break
        # Exponential growth: its rest points are those of the replicator equation.
        grown = shares * np.exp(expected / scale)
        shares = grown * (np.array(sizes) / np.maximum(grown.sum(axis=1), 1e-300))[:, None]
    else:
        raise UserError("the shares of the angles do not come to rest: the payoffs make a cycle")
    return RestPoint(shares, means, max(float(gains.max()), 0.0))


def mandate(
    payoffs: Float[np.ndarray, "angle angle"],
    angles: Sequence[float],
    minimum: float,
    obeyed: float = 1.0,
) -> RestPoint:
    """Return the rest point under a mandated minimum that a share of the drivers obeys.

    The first group obeys it, and the second chooses any angle.

    Args:
        payoffs: Payoff of a driver of the row's angle where all others have the column's.
        angles: The angles, in degrees.
        minimum: Least angle of the first group, in degrees.
        obeyed: Share of the first group among all drivers.

    Raises:
        UserError: If the share is outside [0, 1], no angle reaches the minimum, or the shares of
            the angles do not come to rest.
    """
    if not 0.0 <= obeyed <= 1.0:
        raise UserError(f"a share {obeyed:g} of drivers is outside [0, 1]")
    reaches = np.array(angles) >= minimum
    is_open = np.stack([reaches, np.ones(len(angles), dtype=bool)])
    return rest_point(payoffs, is_open, (obeyed, 1.0 - obeyed))
