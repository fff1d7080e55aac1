"""Actions of the ego: their space, checks of what a caller gives, and the commands they mean."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.worlds.highway.episodes import checked_numbers
from socialiq.worlds.intersection.options import ContinuousOptions, Options
from socialiq.worlds.intersection.state import ACTIONS

ACCELERATION_RANGE = (-5.0, 5.0)  # m/s², of actions -1 and 1
STEERING_RANGE = (-math.pi / 4, math.pi / 4)  # rad


class Commands(NamedTuple):
    """Held commands of the ego, each (batch,).

    Attributes:
        acceleration: m/s².
        steering: Angle of the front wheels, rad.
    """

    acceleration: Float[np.ndarray, " batch"]
    steering: Float[np.ndarray, " batch"]


def width(options: Options) -> int:
    """Return the number of values of a continuous action; 0 if actions are discrete."""
    if not isinstance(options, ContinuousOptions):
        return 0
    return 2 if options.actions == "continuous_steering" else 1


def space_of(options: Options) -> spaces.Discrete | spaces.Box:
    """Return Gymnasium's space of one action: numbers of actions, or values in [-1, 1]."""
    if not options.continuous:
        return spaces.Discrete(len(ACTIONS))
    return spaces.Box(-1.0, 1.0, (width(options),), np.float32)


def checked(actions: Any, size: int, options: Options) -> Any:
    """Return the actions of a batch as an array, int64 or floats as given.

    Args:
        actions: One for each episode: 0, 1 or 2, or rows of values in [-1, 1].
        size: Number of episodes.
        options: Scenario.

    Raises:
        UserError: If they have another shape or type, or one is out of range or NaN.
    """
    if options.continuous:
        return _checked_values(actions, (size, width(options)))
    return checked_numbers(actions, size, len(ACTIONS))


def _checked_values(actions: Any, shape: tuple[int, int]) -> Float[np.ndarray, "batch value"]:
    chosen = np.asarray(actions)
    if chosen.shape != shape or chosen.dtype not in (np.float32, np.float64):
        raise UserError(
            f"actions must be float32 or float64 of the shape {shape}, got {chosen.dtype} of the "
            f"shape {chosen.shape}"
        )
    wrong = chosen[~(np.abs(chosen) <= 1.0)]
    if len(wrong):
        raise UserError(f"actions must lie between -1 and 1, got {wrong[0]}: clip them")
    return chosen


def commands(actions: Float[np.ndarray, "batch value"]) -> Commands:
    """Return the commands that continuous actions mean, computed in the actions' own precision.

    Args:
        actions: Acceleration, and steering if there is a second column, in [-1, 1].
    """
    acceleration = _mapped(actions[:, 0], ACCELERATION_RANGE)
    if actions.shape[1] == 1:
        return Commands(acceleration, np.zeros(len(actions)))
    return Commands(acceleration, _mapped(actions[:, 1], STEERING_RANGE))


def _mapped(
    values: Float[np.ndarray, " batch"], interval: tuple[float, float]
) -> Float[np.ndarray, " batch"]:
    # highway-env's order of operations; in float32 it rounds differently from float64.
    low, high = interval
    return low + (values - -1) * (high - low) / (1 - -1)
