"""Exact dial: a wanted *behavioural* angle as a mixture of two policies, one drawn per episode.

Few angles are those of a single policy: a front has corners, and an optimum at a corner has the
same angle for a range of targets. Mixtures of whole episodes have all angles in between, in
expectation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.social.angle import AngleEstimate, angle_of, interval_around, resampled_means, weights


class Setting(NamedTuple):
    """Mixture of two policies."""

    first: int  # index of one policy
    second: int  # index of the other policy; equal to `first` if a single policy has the angle
    share: float  # share of episodes that the second drives
    radius: float  # length of the mixture's expected sums, along the wanted angle


def mixture(points: Float[np.ndarray, "policy 2"], mixed: Setting) -> Float[np.ndarray, " xy"]:
    """Return the expected sums of a mixture of two policies.

    Args:
        points: Expected sums of (r_env, r_social) of each policy.
        mixed: The two policies, and the share of the second.
    """
    return (1.0 - mixed.share) * points[mixed.first] + mixed.share * points[mixed.second]


def setting(points: Float[np.ndarray, "policy 2"], angle: float) -> Setting:
    """Return the mixture of two policies at an angle with the largest radius.

    Mixtures of more policies are no larger: the ray leaves the convex hull through an edge.

    Args:
        points: Expected sums of (r_env, r_social) of each policy.
        angle: The angle, in degrees.

    Raises:
        UserError: If no mixture of these policies has this angle.
    """
    ray = np.array(weights(angle))
    across = points @ np.array([-ray[1], ray[0]])
    along = points @ ray
    before = across[:, None]
    after = across[None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = before / (before - after)
    share = np.where(before == after, 0.0, share)
    on_ray = (before * after <= 0.0) & ((before != after) | (before == 0.0))
    radius = np.where(on_ray, (1.0 - share) * along[:, None] + share * along[None, :], -np.inf)
    first, second = np.unravel_index(radius.argmax(), radius.shape)
    if radius[first, second] < 0.0:
        angles = sorted(angle_of(*point) for point in points)
        raise UserError(
            f"no mixture of these policies lies at {angle:g} degrees: theirs are at "
            f"{angles[0]:.0f} to {angles[-1]:.0f} degrees; choose an angle between them, or train "
            "more angles"
        )
    return Setting(int(first), int(second), float(share[first, second]), float(radius.max()))


def mixed_angle(
    first: Float[np.ndarray, "episode 2"],
    second: Float[np.ndarray, "other_episode 2"],
    share: float,
    seed: int,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> AngleEstimate:
    """Return α̂ of a mixture from rollouts of its two policies, with a bootstrap interval.

    Args:
        first: Sums of (r_env, r_social) of each episode of the first policy.
        second: The same of the second policy.
        share: Share of episodes that the second drives in the mixture.
        seed: Seed of the bootstrap.
        confidence: Confidence of the interval.
        resamples: Number of resamples.

    Raises:
        UserError: If a policy has no episode.
    """
    if not len(first) or not len(second):
        raise UserError("an angle needs at least one episode of each policy")
    env, social = (1.0 - share) * first.mean(axis=0) + share * second.mean(axis=0)
    angle = angle_of(env, social)
    means = [
        resampled_means(totals, 2 * seed + stream, resamples)
        for stream, totals in enumerate((first, second))
    ]
    points = (1.0 - share) * means[0] + share * means[1]
    return AngleEstimate(angle, *interval_around(angle, points, confidence), env, social)
