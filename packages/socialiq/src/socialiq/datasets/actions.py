"""Actions of other programs: numbers of actions, or vectors in their units, scaled to [-1, 1]."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Shaped

from socialiq.datasets.plain_columns import number_of, whole_of
from socialiq.errors import UserError

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
        ends = [np.asarray(one, np.float64) for one in (low, high)]
        if ends[0].shape != ends[1].shape or not np.isfinite(ends).all():
            raise UserError(
                f"bounds of actions need as many finite lower ends as upper ones, got {list(low)} "
                f"and {list(high)}"
            )
        if not (ends[0] < ends[1]).all():
            raise UserError(
                f"each lower bound of an action must be below the upper one, got {list(low)} and "
                f"{list(high)}"
            )
        return Bounds(*(tuple(one.tolist()) for one in ends))

    def as_json(self) -> dict[str, list[float]]:
        """Return both ends by name."""
        return {"low": list(self.low), "high": list(self.high)}

    def scaled(self, actions: Float[np.ndarray, "row size"]) -> Float[np.ndarray, "row size"]:
        """Return actions in [-1, 1]; what is beyond an end by rounding is moved to it.

        Raises:
            UserError: If there are more or fewer numbers, or one is outside; the line names the
                first row.
        """
        sizes = {1, actions.shape[1]}
        if len(self.low) not in sizes:
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
    found = plain_actions(values)
    if n_actions and found.ndim == 2:
        raise UserError(
            f"action is {found.dtype} of shape {found.shape}: pass one integer for each step, or, "
            "for continuous actions, no number of actions (--n-actions)"
        )
    if found.ndim == 1:
        if bounds is not None:
            raise UserError(
                "action holds integers: bounds are of continuous actions, leave them out"
            )
        return found
    # What is too large for float32 becomes infinity here, which the table refuses.
    with np.errstate(over="ignore"):
        return (found if bounds is None else bounds.scaled(found)).astype(np.float32)
