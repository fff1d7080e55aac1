"""Demonstrations from plain arrays of other programs; the remaining columns are derived.

Nothing is assumed: facts that the arrays do not contain must be given.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int32

from socialiq.demonstrations.columns import flags_of, steps_of
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.types import Ending, RewardPair

SOCIAL = ("", "none")
"""Meaning of a reward of one number a step: not given, or r_env with r_social 0."""


def of_steps(
    observation: Any,
    action: Any,
    reward: Any,
    *,
    n_actions: int,
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
        action: a, (steps,), integers in [0, n_actions).
        reward: (r_env, r_social), (steps, 2); or (steps,) with `social`.
        n_actions: Number of actions of the world; the data may lack some.
        terminated: Whether s' is a terminal state, (steps,).
        truncated: Whether the clock cut the episode at s', (steps,).
        ending: Values of `types.Ending`, (steps,), instead of the flags or with them. Without it a
            terminal state is `OTHER`.
        episode: 0, 1, 2, ..., (steps,); without it an episode ends where a flag is set.
        step: Number of the step in its episode, (steps,); without it the rows are counted.
        next_observation: s'; without it the observation of the episode's next row.
        final_observation: s' of each episode's last row, (episodes, features); needed only
            without `next_observation`.
        mode: Demonstrator of each row, an index into `mode_names`; the first without it.
        mode_names: Names of the demonstrators.
        social: "none" if a reward of one number a step is r_env, and r_social is 0.
        flatten: Whether observations of more axes (images) are flattened to one.
        source: Provenance of the data.

    Raises:
        UserError: If a column is missing or wrong; the line names it.
    """
    seen = features_of("observation", observation, flatten)
    rows = len(seen)
    flags = [flag_of(name, one) for name, one in _given(terminated=terminated, truncated=truncated)]
    kinds = None if ending is None else whole_of("ending", ending).astype(np.int8)
    ends = _ends(rows, *flags, kinds) if flags or kinds is not None else None
    number = _episodes(rows, episode, ends)
    columns = {
        "observation": seen,
        "action": whole_of("action", action),
        "next_observation": _next(seen, number, next_observation, final_observation, flatten),
        **_endings(rows, terminated, truncated, kinds),
        "mode": np.zeros(rows, np.int8) if mode is None else whole_of("mode", mode).astype(np.int8),
        "episode": number,
        "step": steps_of(number) if step is None else whole_of("step", step),
    }
    pair = pair_of(reward, social)
    arrays = {**columns, "r_env": pair.env, "r_social": pair.social}
    return Demonstrations.of_arrays(arrays, mode_names, n_actions, source or {})


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
        UserError: If it is anything else, for instance continuous actions.
    """
    array = number_of(name, values)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or array.dtype.kind not in "iu":
        what = "; only discrete actions are supported" if name == "action" else ""
        raise UserError(
            f"{name} is {array.dtype} of shape {array.shape}: pass one integer for each step{what}"
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


def _given(**columns: Any) -> list[tuple[str, Any]]:
    return [(name, one) for name, one in columns.items() if one is not None]


def _ends(rows: int, *columns: Any) -> Bool[np.ndarray, " row"]:
    """Return whether an episode ends at each row, by any of the columns."""
    ends = np.zeros(rows, np.bool_)
    for one in columns:
        if one is not None:
            if len(one) != rows:
                raise UserError(
                    f"terminated, truncated and ending need {rows} rows, as observation has: one "
                    f"has {len(one)}"
                )
            ends |= one != 0
    return ends


def _episodes(rows: int, episode: Any, ends: Any) -> Int32[np.ndarray, " row"]:
    if episode is not None:
        number = whole_of("episode", episode)
        if len(number) != rows:
            raise UserError(f"episode has {len(number)} rows where observation has {rows}")
        return number
    if ends is None:
        raise UserError(
            "nothing says where an episode ends: pass terminated and truncated, or episode"
        )
    return np.cumsum(np.concatenate([[0], ends[:-1]]), dtype=np.int32)


def _endings(rows: int, terminated: Any, truncated: Any, kinds: Any) -> dict[str, np.ndarray]:
    """Return the flags and the kind of ending; `Demonstrations` checks that they agree."""
    no = np.zeros(rows, np.bool_)
    if kinds is None:
        kinds = no.astype(np.int8)
        if truncated is not None:
            kinds[flag_of("truncated", truncated)] = Ending.TIMEOUT
        if terminated is not None:
            kinds[flag_of("terminated", terminated)] = Ending.OTHER
    ended, timeout = flags_of(kinds)
    return {
        "terminated": ended if terminated is None else flag_of("terminated", terminated),
        "truncated": timeout if truncated is None else flag_of("truncated", truncated),
        "ending": kinds,
    }


def _next(
    seen: Float32[np.ndarray, "row feature"],
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
        raise UserError(
            "what follows an episode's last step is not known: pass next_observation, or "
            f"final_observation, a row for each of {len(last)} episodes"
        )
    ends = features_of("final_observation", final, flatten)
    if ends.shape != (len(last), seen.shape[1]):
        raise UserError(
            f"final_observation has shape {ends.shape}: pass one row of {seen.shape[1]} features "
            f"for each of {len(last)} episodes"
        )
    after = np.roll(seen, -1, axis=0)
    after[last] = ends
    return after
