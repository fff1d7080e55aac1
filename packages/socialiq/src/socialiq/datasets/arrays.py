"""Demonstrations from plain arrays of other programs, checked one by one; the rest is derived.

Nothing is assumed: facts that the arrays do not contain must be given.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int32, Shaped

from socialiq.demonstrations.columns import flags_of, steps_of
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.types import ACTION_BOUNDS, Ending, RewardPair

SOCIAL = ("", "none")
"""Meaning of a reward of one number a step: not given, or r_env with r_social 0."""
ROUNDING = 1e-6
"""Distance beyond a bound, in halves of the range, that counts as rounding: of float32 near 1."""


class Bounds(NamedTuple):
    """Ends of continuous actions in their own units; -1 and 1 here."""

    low: tuple[float, ...]  # lower end of each number
    high: tuple[float, ...]  # upper end of each number

    @staticmethod
    def of(low: Sequence[float], high: Sequence[float]) -> Bounds | None:
        """Return checked bounds.

        Args:
            low: Lower end of each number.
            high: Upper end of each number, as many as lower ends.

        Returns:
            The bounds; None if neither end is given.

        Raises:
            UserError: If the ends are not equally many finite numbers, or a lower one is not below
                its upper one.
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

        An action of another size or outside is refused; the line names the first row.
        """
        if len(self.low) not in (1, actions.shape[1]):
            raise UserError(
                f"actions have {actions.shape[1]} numbers and {len(self.low)} bounds: give one "
                "lower and one upper bound, or one of each for every number"
            )
        low = np.array(self.low)
        high = np.array(self.high)
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


def of_steps(
    observation: Any,
    action: Any,
    reward: Any,
    *,
    n_actions: int = 0,
    bounds: Bounds | None = None,
    terminated: Any = None,
    truncated: Any = None,
    ending: Any = None,
    episode: Any = None,
    step: Any = None,
    next_observation: Any = None,
    final_observation: Any = None,
    mode: Any = None,
    mode_names: tuple[str, ...] = ("demonstrator",),
    social: str = "",
    flatten: bool = False,
    source: dict[str, Any] | None = None,
) -> Demonstrations:
    """Make a table of one row for each step, in order.

    Args:
        observation: s, (steps, features), or (steps,) of one feature; any numeric type.
        action: a, (steps,), integers in [0, n_actions); continuous ones (steps, size), floats.
        reward: (r_env, r_social), (steps, 2); or (steps,) with `social`.
        n_actions: Number of actions of the world; 0 for continuous ones.
        bounds: Ends of continuous actions in their own units, which `source` keeps; else -1 and 1.
        terminated: Whether s' is a terminal state, (steps,).
        truncated: Whether the clock cut the episode at s', (steps,).
        ending: Values of `types.Ending`, (steps,), with or without the flags; else `OTHER`.
        episode: 0, 1, 2, ..., (steps,); without it an episode ends where a flag is set.
        step: Number of the step in its episode, (steps,); without it the rows are counted.
        next_observation: s'; without it the observation of the episode's next row, and
        final_observation: s' of each episode's last row, (episodes, features). Without both, the s
            of a row that reaches a terminal state stands for its s', and the last row of any
            further episode is left out: the row before it is then cut by the clock.
        mode: Demonstrator of each row, an index into `mode_names`; the first without it.
        mode_names: Names of the demonstrators.
        social: "none" if a reward of one number a step is r_env, and r_social is 0.
        flatten: Whether observations of more axes (images) are flattened to one.
        source: Provenance of the data.

    Raises:
        UserError: If a column is missing or wrong; the line names it.
    """
    observed = features_of("observation", observation, flatten)
    arrays = _ends_of(len(observed), terminated, truncated, ending, episode)
    number = arrays["episode"]
    pair = pair_of(reward, social)
    modes = np.zeros(len(observed)) if mode is None else whole_of("mode", mode)
    arrays |= {
        "observation": observed,
        "action": actions_of(action, n_actions, bounds),
        "next_observation": _next(observed, number, next_observation, final_observation, flatten),
        "r_env": pair.env,
        "r_social": pair.social,
        "mode": modes.astype(np.int8),
        "step": steps_of(number) if step is None else whole_of("step", step),
    }
    if next_observation is None and final_observation is None:
        arrays = _without_unknown(arrays)
    origin = {} if bounds is None else {ACTION_BOUNDS: bounds.as_json()}
    return Demonstrations.of_arrays(arrays, mode_names, n_actions, {**(source or {}), **origin})


def _ends_of(
    rows: int, terminated: Any, truncated: Any, ending: Any, episode: Any
) -> dict[str, np.ndarray]:
    """Return the columns that say where episodes end and how, from those that are given."""
    flags = {}
    for name, values in (("truncated", truncated), ("terminated", terminated)):
        if values is not None:
            flag = number_of(name, values)
            if flag.ndim != 1 or flag.dtype.kind not in "biu" or not np.isin(flag, (0, 1)).all():
                raise UserError(
                    f"{name} is {flag.dtype} of shape {flag.shape}: pass one boolean a step"
                )
            flags[name] = flag.astype(np.bool_)
    kinds = None if ending is None else whole_of("ending", ending).astype(np.int8)
    ends = [*flags.values(), *([] if kinds is None else [kinds])]
    for column in ends:
        if len(column) != rows:
            raise UserError(
                f"terminated, truncated and ending need {rows} rows, as observation has: one has "
                f"{len(column)}"
            )
    if episode is not None:
        number = whole_of("episode", episode)
        if len(number) != rows:
            raise UserError(f"episode has {len(number)} rows where observation has {rows}")
    elif ends:
        over = np.any([column != 0 for column in ends], axis=0)
        number = np.cumsum(np.concatenate([[0], over[:-1]]), dtype=np.int32)
    else:
        raise UserError(
            "nothing says where an episode ends: pass terminated and truncated, or episode"
        )
    if kinds is None:  # `Demonstrations` checks that flags and kinds agree
        kinds = np.zeros(rows, np.int8)
        for name, flag in flags.items():
            kinds[flag] = Ending.TIMEOUT if name == "truncated" else Ending.OTHER
    terminal, timeout = flags_of(kinds)
    return {"terminated": terminal, "truncated": timeout, **flags, "ending": kinds} | {
        "episode": number
    }


def _next(
    observed: Float32[np.ndarray, "row feature"],
    episode: Int32[np.ndarray, " row"],
    following: Any,
    final: Any,
    flatten: bool,
) -> Float32[np.ndarray, "row feature"]:
    """Return s' of each row."""
    if following is not None:
        return features_of("next_observation", following, flatten)
    last = np.flatnonzero(np.diff(episode, append=episode[-1:] + 1))
    if final is None:
        final = observed[last]
    ends = features_of("final_observation", final, flatten)
    if ends.shape != (len(last), observed.shape[1]):
        raise UserError(
            f"final_observation has shape {ends.shape}: pass one row of {observed.shape[1]} "
            f"features for each of {len(last)} episodes"
        )
    after = np.roll(observed, -1, axis=0)
    after[last] = ends
    return after


def _without_unknown(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return columns without the last rows of episodes that end elsewhere than in a terminal state.

    What follows these rows is not known. The rows before them are then cut by the clock.
    """
    number = arrays["episode"]
    last = np.diff(number, append=number[-1:] + 1) != 0
    unknown = np.flatnonzero(last & ~arrays["terminated"])
    before = unknown - 1
    alone = unknown[steps_of(number)[unknown] == 0]
    if len(alone):
        raise UserError(
            f"episode {number[alone[0]]} has one step, and what follows it is not known: pass "
            "next_observation or final_observation, or leave the episode out"
        )
    arrays["truncated"][before] = True
    arrays["ending"][before] = Ending.TIMEOUT
    return {name: np.delete(column, unknown, axis=0) for name, column in arrays.items()}


def pair_of(reward: Any, social: str) -> RewardPair:
    """Return the reward pair of each step.

    Args:
        reward: (r_env, r_social), (steps, 2); or (steps,) with `social`.
        social: "none" if a reward of one number a step is r_env, and r_social is 0; else "".

    Raises:
        UserError: If the reward has another shape, or r_social is not known.
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

    Args:
        name: Name of the array in messages.
        observation: (steps, features), or (steps,) of one feature.
        flatten: Whether observations of more axes are flattened to one.

    Raises:
        UserError: If it is not an array of numbers, is empty, or has more axes and `flatten` is
            false.
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

    Args:
        name: Name of the column in messages; `ending` and `mode` must fit 8 bits.
        values: (steps,) or (steps, 1).

    Raises:
        UserError: If the values are anything else, or too large.
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


def number_of(name: str, values: Any) -> np.ndarray:
    """Return an array of numbers.

    Args:
        name: Name of the array in messages.
        values: The numbers or booleans, with at least one axis.

    Raises:
        UserError: If the values are nested, ragged or objects.
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


def plain_actions(values: Any) -> Shaped[np.ndarray, "row ..."]:
    """Return actions as they are: numbers, int32 (row,), or vectors of floats, (row, size)."""
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
    """Return the column of actions of a table.

    Args:
        values: Actions: integers, (steps,), or floats, (steps, size).
        n_actions: Number of actions; 0 for continuous ones.
        bounds: Ends of continuous actions in their units; None for -1 and 1.

    Returns:
        int32 (steps,), or float32 (steps, size) in [-1, 1].

    Raises:
        UserError: If the values have another kind, or an action is out of its bounds.
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
