"""Columns of other programs, checked one by one: rewards, features, integers, booleans."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int32

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
    # What is too large for float32 becomes infinity here, which the table refuses.
    with np.errstate(over="ignore"):
        return array.reshape(len(array), -1).astype(np.float32)


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
