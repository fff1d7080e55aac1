"""Columns of other programs, checked one by one: rewards, features, integers, booleans, actions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, Shaped

from socialiq.errors import UserError, one_of
from socialiq.types import RewardPair

SOCIAL = ("", "none")
"""Meaning of a reward of one number a step: not given, or r_env with r_social 0."""


def pair_of(reward: Any, social: str) -> RewardPair:
    """Return the reward pair of (steps, 2), or of (steps,) where `social` says that r_social is 0.

    Raises:
        UserError: If it is neither, or `social` is not given.
    """
    one_of("social", social, SOCIAL)
    array = number_of("reward", reward).astype(np.float64)
    if array.ndim == 2 and array.shape[1] == 2:
        return RewardPair(array[:, 0].copy(), array[:, 1].copy())
    if array.ndim != 1:
        raise UserError(
            f"reward has shape {array.shape}: pass (steps, 2), r_env and r_social of each step"
        )
    if social != "none":
        raise UserError(
            "reward has one number for each step, so r_social is not known: pass (steps, 2), or "
            "say social none, which makes it r_env with r_social 0"
        )
    return RewardPair(array, np.zeros(len(array)))


def features_of(name: str, observation: Any, flatten: bool) -> Float32[np.ndarray, "row feature"]:
    """Return observations as float32, one row for each.

    Raises:
        UserError: If they are nested, not numbers, or of more axes and `flatten` is not set.
    """
    array = number_of(name, observation)
    if array.ndim == 1:
        array = array[:, None]
    if not array.size:
        raise UserError(f"{name} has shape {array.shape}: pass at least one row of one feature")
    if array.ndim > 2 and not flatten:
        raise UserError(
            f"{name} has shape {array.shape}: pass (steps, features), or flatten it (flatten)"
        )
    return _as_float32(array.reshape(len(array), -1))


def whole_of(name: str, values: Any) -> Int32[np.ndarray, " row"]:
    """Return a column of integers.

    Raises:
        UserError: If it is anything else.
    """
    array = number_of(name, values)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise UserError(
            f"{name} is {array.dtype} of shape {array.shape}: pass one integer for each step"
        )
    limits = np.iinfo(np.int8 if name in ("ending", "mode") else np.int32)
    if len(array) and (int(array.max()) > limits.max or int(array.min()) < limits.min):
        raise UserError(f"{name} holds {int(array.max())}: number from 0")
    return array.astype(np.int32)


def flag_of(name: str, values: Any) -> Bool[np.ndarray, " row"]:
    """Return a column of booleans.

    Raises:
        UserError: If it is not booleans, or zeros and ones.
    """
    array = number_of(name, values)
    if array.ndim != 1 or array.dtype.kind not in "biu" or not np.isin(array, (0, 1)).all():
        raise UserError(f"{name} is {array.dtype} of shape {array.shape}: pass one boolean a step")
    return array.astype(np.bool_)


def number_of(name: str, values: Any) -> np.ndarray:
    """Return an array of numbers.

    Raises:
        UserError: If it is nested, ragged or of objects.
    """
    if isinstance(values, dict):
        raise UserError(f"{name} is a dict: pass one array, its parts side by side as features")
    try:
        array = np.asarray(values)
    except (ValueError, TypeError) as error:  # ragged rows
        raise UserError(
            f"{name} is not an array of numbers: give every step the same shape"
        ) from error
    if array.dtype.kind not in "fiub" or array.ndim == 0:
        raise UserError(
            f"{name} is {array.dtype} with {array.ndim} axes: pass an array of numbers, one row "
            "for each step"
        )
    return array


ROUNDING = 1e-6
"""Distance beyond a bound, in halves of the range, that counts as rounding: of float32 near 1."""


class Bounds(NamedTuple):
    """Ends of continuous actions in their own units; -1 and 1 here.

    Attributes:
        low: Lower end of each number.
        high: Upper end of each number.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]

    @staticmethod
    def of(low: Sequence[float], high: Sequence[float]) -> Bounds | None:
        """Return checked bounds; None if neither end is given.

        Raises:
            UserError: If one end alone is given, or they are not finite numbers, as many below as
                above, each lower one below its upper one.
        """
        if not len(low) and not len(high):
            return None
        lower, upper = (np.asarray(ends, np.float64) for ends in (low, high))
        if lower.shape != upper.shape or not np.isfinite([lower, upper]).all():
            raise UserError(
                f"bounds of actions need as many finite lower ends as upper ones, got {list(low)} "
                f"and {list(high)}"
            )
        if not (lower < upper).all():
            raise UserError(
                f"each lower bound of an action must be below the upper one, got {list(low)} and "
                f"{list(high)}"
            )
        return Bounds(tuple(lower.tolist()), tuple(upper.tolist()))

    def as_json(self) -> dict[str, list[float]]:
        """Return both ends by name."""
        return {"low": list(self.low), "high": list(self.high)}

    def scaled(self, actions: Float[np.ndarray, "row size"]) -> Float[np.ndarray, "row size"]:
        """Return actions in [-1, 1]; what is beyond an end by rounding is moved to it.

        Raises:
            UserError: If there are more or fewer numbers, or one is outside; the line names the
                first row.
        """
        if len(self.low) not in (1, actions.shape[1]):
            raise UserError(
                f"actions have {actions.shape[1]} numbers and {len(self.low)} bounds: give one "
                "lower and one upper bound, or one of each for every number"
            )
        low, high = np.array(self.low), np.array(self.high)
        if (low == -1.0).all() and (high == 1.0).all():
            return actions  # to the bit
        unit = (actions - low) * (2.0 / (high - low)) - 1.0
        outside = (np.abs(unit) > 1.0 + ROUNDING).any(axis=1)  # NaN is refused by the table
        if outside.any():
            row = int(np.argmax(outside))
            raise UserError(
                f"column action, row {row}: {actions[row].tolist()} is outside the bounds "
                f"{self.low} to {self.high}: correct the bounds"
            )
        return np.clip(unit, -1.0, 1.0)


def plain_actions(values: Any) -> Shaped[np.ndarray, "row ..."]:
    """Return actions as they are: numbers of actions, int32 (row,), or vectors, float (row, size).

    Raises:
        UserError: If they are neither.
    """
    array = number_of("action", values)
    if array.dtype.kind != "f":
        return whole_of("action", array)
    vectors = array[:, None] if array.ndim == 1 else array
    if vectors.ndim != 2 or not vectors.shape[1]:
        raise UserError(
            f"action is {array.dtype} of shape {array.shape}: pass one integer for each step, or "
            "one vector of floats"
        )
    return vectors


def actions_of(
    values: Any, n_actions: int, bounds: Bounds | None
) -> Shaped[np.ndarray, "row ..."] | Float32[np.ndarray, "row size"]:
    """Return the column of actions of a table: int32, or float32 vectors in [-1, 1].

    Args:
        values: The actions.
        n_actions: Number of discrete actions; 0 for continuous ones.
        bounds: Ends of continuous actions in their units; None if they are -1 and 1.

    Raises:
        UserError: If they are of the other kind or outside the bounds.
    """
    actions = plain_actions(values)
    if n_actions and actions.ndim == 2:
        raise UserError(
            f"action is {actions.dtype} of shape {actions.shape}: pass one integer for each step, "
            "or, for continuous actions, no number of actions (--n-actions)"
        )
    if actions.ndim == 1:
        if bounds is not None:
            raise UserError(
                "action holds integers: bounds are of continuous actions, leave them out"
            )
        return actions
    return _as_float32(actions if bounds is None else bounds.scaled(actions))


def _as_float32(array: np.ndarray) -> np.ndarray:
    """Return float32; what is too large becomes infinity, which the table refuses."""
    with np.errstate(over="ignore"):
        return array.astype(np.float32)
