"""Largest loss that the reward's own limits allow, for the field `margin.largest_loss`."""

from __future__ import annotations

import math

from socialiq.audit.profile.environment import Environment
from socialiq.audit.profile.junction import Junction
from socialiq.audit.profile.scenario import World
from socialiq.social.angle import exact_weights
from socialiq.worlds.enumerate import episode_range
from socialiq.worlds.intersection.episode_range import env_range, is_unlimited, social_range
from socialiq.worlds.intersection.world import Intersection

_DIGITS = 4  # to which the limit is rounded up, so that a profile shows a short number


def possible_loss(world: World, angle: float) -> float | None:
    """Return the most by which R(α) of two drivers can differ in one episode.

    It is the range of R(α) over all drivers and episodes: exact in a gridworld; at the
    intersection from the limits of each signal, the largest number of vehicles and the time limit.

    Args:
        world: World of the episodes.
        angle: Social angle α in degrees.

    Returns:
        The difference, rounded up; None where the limits are not known: in an environment, at a
        recorded junction, and where the ego steers along a turn.
    """
    if isinstance(world, Environment | Junction):
        return None
    if isinstance(world, Intersection) and is_unlimited(world.options):
        return None
    weights = exact_weights(angle)
    if isinstance(world, Intersection):
        sides = env_range(world.options), social_range(world.options)
        difference = sum(abs(w) * side.width for w, side in zip(weights, sides, strict=True))
    else:
        low, high = episode_range(world, weights)
        difference = high - low
    return _rounded_up(difference)


def _rounded_up(value: float) -> float:
    """Return the value rounded up to `_DIGITS` significant digits, well above rounding errors."""
    if value <= 0.0:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - _DIGITS + 1)
    return round(math.ceil(value * (1.0 + 1e-9) / unit) * unit, 12)
