"""Demonstrations from plain arrays of other programs; the remaining columns are derived.

Nothing is assumed: facts that the arrays do not contain must be given.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float32, Int32

from socialiq.datasets.columns import Bounds, actions_of, features_of, flag_of, pair_of, whole_of
from socialiq.demonstrations.columns import flags_of, steps_of
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import ACTION_BOUNDS, Ending


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
        n_actions: Number of actions of the world, of which the data may lack some; 0 for
            continuous ones.
        bounds: Ends of continuous actions in their own units, which `source` keeps; without them
            actions must be in [-1, 1].
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
    observed = features_of("observation", observation, flatten)
    rows = len(observed)
    flags = {"truncated": truncated, "terminated": terminated}
    flags = {name: flag_of(name, flag) for name, flag in flags.items() if flag is not None}
    kinds = None if ending is None else whole_of("ending", ending).astype(np.int8)
    ends = [*flags.values(), *([] if kinds is None else [kinds])]
    for column in ends:
        if len(column) != rows:
            raise UserError(
                f"terminated, truncated and ending need {rows} rows, as observation has: one has "
                f"{len(column)}"
            )
    number = _episodes(rows, episode, ends)
    if kinds is None:  # `Demonstrations` checks that flags and kinds agree
        kinds = np.zeros(rows, np.int8)
        for name, flag in flags.items():
            kinds[flag] = Ending.TIMEOUT if name == "truncated" else Ending.OTHER
    terminal, timeout = flags_of(kinds)
    pair = pair_of(reward, social)
    arrays = {
        "observation": observed,
        "action": actions_of(action, n_actions, bounds),
        "next_observation": _next(observed, number, next_observation, final_observation, flatten),
        "terminated": flags.get("terminated", terminal),
        "truncated": flags.get("truncated", timeout),
        "ending": kinds,
        "r_env": pair.env,
        "r_social": pair.social,
        "mode": np.zeros(rows, np.int8) if mode is None else whole_of("mode", mode).astype(np.int8),
        "episode": number,
        "step": steps_of(number) if step is None else whole_of("step", step),
    }
    origin = {} if bounds is None else {ACTION_BOUNDS: bounds.as_json()}
    return Demonstrations.of_arrays(arrays, mode_names, n_actions, {**(source or {}), **origin})


def _episodes(rows: int, episode: Any, ends: list[np.ndarray]) -> Int32[np.ndarray, " row"]:
    """Return the number of each row's episode, which ends at a row by any of the columns."""
    if episode is not None:
        number = whole_of("episode", episode)
        if len(number) != rows:
            raise UserError(f"episode has {len(number)} rows where observation has {rows}")
        return number
    if not ends:
        raise UserError(
            "nothing says where an episode ends: pass terminated and truncated, or episode"
        )
    over = np.any([column != 0 for column in ends], axis=0)
    return np.cumsum(np.concatenate([[0], over[:-1]]), dtype=np.int32)


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
        raise UserError(
            "what follows an episode's last step is not known: pass next_observation, or "
            f"final_observation, a row for each of {len(last)} episodes"
        )
    ends = features_of("final_observation", final, flatten)
    if ends.shape != (len(last), observed.shape[1]):
        raise UserError(
            f"final_observation has shape {ends.shape}: pass one row of {observed.shape[1]} "
            f"features for each of {len(last)} episodes"
        )
    after = np.roll(observed, -1, axis=0)
    after[last] = ends
    return after
