"""Layout of the columns of a demonstrations table, and the checks that make them one table.

A message names the column, its first bad row and the correction. Later checks rely on earlier
ones, so the order here is the order of the messages.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Int, Int32

from socialiq.errors import UserError
from socialiq.types import Ending

# The type and number of axes of each column of discrete actions; also the order of columns in a
# file. Continuous actions are (np.float32, 2).
LAYOUT: dict[str, tuple[type[np.generic], int]] = {
    "observation": (np.float32, 2),
    "action": (np.int32, 1),
    "next_observation": (np.float32, 2),
    "terminated": (np.bool_, 1),
    "truncated": (np.bool_, 1),
    "ending": (np.int8, 1),
    "r_env": (np.float64, 1),
    "r_social": (np.float64, 1),
    "mode": (np.int8, 1),
    "episode": (np.int32, 1),
    "step": (np.int32, 1),
}


def check(columns: Mapping[str, Any], n_actions: Any, mode_names: Any) -> None:
    """Refuse columns that do not make one table of demonstrations.

    Args:
        columns: One array for each name of `LAYOUT`.
        n_actions: Number of discrete actions, `action` in [0, n_actions); 0 for continuous ones,
            float32 rows in [-1, 1].
        mode_names: Names that `mode` indexes.

    Raises:
        UserError: At the first violation.
    """
    continuous = type(n_actions) is int and n_actions == 0 and is_continuous(columns["action"])
    _check_names(1 if continuous else n_actions, mode_names)
    layout = LAYOUT | {"action": (np.float32, 2)} if continuous else LAYOUT
    _check_layout(columns, layout)
    _check_finite(columns, layout)
    if continuous:
        _check_bounded(columns["action"])
    else:
        _check_range("action", columns["action"], n_actions, "n_actions")
    _check_range("mode", columns["mode"], len(mode_names), "the number of mode_names")
    _check_episodes(columns["episode"])
    _check_endings(columns)
    _check_within_episodes(columns)
    _check_steps(columns)


def is_continuous(action: Any) -> bool:
    """Whether actions are arrays of floats, (transition, size)."""
    return isinstance(action, np.ndarray) and action.dtype.kind == "f" and action.ndim == 2


def flags_of(
    ending: Int[np.ndarray, " transition"],
) -> tuple[Bool[np.ndarray, " transition"], Bool[np.ndarray, " transition"]]:
    """Return (terminated, truncated) of each row, from its value of `types.Ending`."""
    truncated = ending == Ending.TIMEOUT
    return (ending != Ending.NONE) & ~truncated, truncated


def steps_of(episode: Int[np.ndarray, " transition"]) -> Int32[np.ndarray, " transition"]:
    """Number the rows of each episode from 0; rows of equal episode numbers are adjacent."""
    begins = np.diff(episode, prepend=episode[:1] - 1) != 0
    row = np.arange(len(episode))
    return (row - np.maximum.accumulate(np.where(begins, row, 0))).astype(np.int32)


def json_able(source: Any) -> dict[str, Any]:
    """Return provenance as a JSON file would give it back: tuples become lists.

    Raises:
        UserError: If it is not a dict that JSON can hold.
    """
    if not isinstance(source, dict):
        raise UserError(f"source is a {type(source).__name__}: pass a dict of what made the data")
    try:
        return json.loads(json.dumps(source, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise UserError(
            f"source cannot be written as JSON ({error}): keep to strings, finite numbers, "
            "lists and dicts"
        ) from error


def _check_names(n_actions: Any, mode_names: Any) -> None:
    # bool is an int to Python, and a NumPy integer would not go into a file's JSON header.
    if not isinstance(n_actions, int) or isinstance(n_actions, bool) or n_actions < 1:
        raise UserError(f"n_actions is {n_actions!r}: pass a Python int of at least 1")
    if not isinstance(mode_names, tuple) or not all(
        isinstance(name, str) and name for name in mode_names
    ):
        raise UserError("mode_names must be a tuple of non-empty strings")
    if len(set(mode_names)) < len(mode_names) or len(mode_names) > np.iinfo(np.int8).max:
        raise UserError("mode_names must be distinct, and at most 127: merge or rename modes")


Layout = Mapping[str, tuple[type[np.generic], int]]


def _check_layout(columns: Mapping[str, Any], layout: Layout) -> None:
    for name, (dtype, axes) in layout.items():
        column = columns[name]
        if not isinstance(column, np.ndarray):
            raise UserError(
                f"column {name} is a {type(column).__name__}: pass a NumPy array of "
                f"{dtype.__name__}"
            )
        if column.dtype != dtype:
            raise UserError(
                f"column {name} is {column.dtype}: convert it with .astype(np.{dtype.__name__})"
            )
        if column.ndim != axes:
            raise UserError(f"column {name} has {column.ndim} axes: reshape it to {axes}")
    rows = len(columns["action"])
    if rows == 0:
        raise UserError("column action has no rows: pass at least one transition")
    for name in LAYOUT:
        if len(columns[name]) != rows:
            raise UserError(
                f"column {name} has {len(columns[name])} rows where action has {rows}: "
                "pass one row per transition"
            )
    features, next_features = (
        columns[name].shape[1] for name in ("observation", "next_observation")
    )
    if features != next_features:
        raise UserError(
            f"column next_observation has {next_features} features where observation has "
            f"{features}: encode both the same way"
        )


def _refuse(name: str, bad: np.ndarray, problem: str) -> None:
    """Refuse the column if any row is bad, naming the first."""
    if bad.any():
        raise UserError(f"column {name}, row {int(np.argmax(bad))}: {problem}")


def _check_finite(columns: Mapping[str, Any], layout: Layout) -> None:
    for name, (dtype, axes) in layout.items():
        if issubclass(dtype, np.floating):
            bad = ~np.isfinite(columns[name])
            _refuse(
                name,
                bad.any(axis=1) if axes == 2 else bad,
                "not finite: leave out the episode, or correct its recording",
            )


def _check_bounded(action: np.ndarray) -> None:
    if action.shape[1] == 0:
        raise UserError("column action has rows without a number: pass one or more for each row")
    _refuse(
        "action",
        np.abs(action).max(axis=1) > 1.0,
        "outside [-1, 1]: scale actions by the bounds of their space",
    )


def _check_range(name: str, column: np.ndarray, size: int, what: str) -> None:
    _refuse(
        name,
        (column < 0) | (column >= size),
        f"outside [0, {size}): number from 0 and check {what}",
    )


def _check_episodes(episode: np.ndarray) -> None:
    steps = np.diff(episode, prepend=0)
    bad = (steps != 0) & (steps != 1)
    bad[0] = episode[0] != 0
    _refuse("episode", bad, "number episodes 0, 1, 2, ... in order, with their rows adjacent")


def _check_endings(columns: Mapping[str, Any]) -> None:
    ending, terminated, truncated = (
        columns[name] for name in ("ending", "terminated", "truncated")
    )
    _refuse(
        "ending",
        ~np.isin(ending, [int(kind) for kind in Ending]),
        f"not a value of types.Ending: use {', '.join(f'{e.value} {e.name}' for e in Ending)}",
    )
    _refuse(
        "ending",
        (ending == Ending.NONE) != (~terminated & ~truncated),
        "must be 0 NONE exactly where neither terminated nor truncated",
    )
    _refuse(
        "ending",
        (ending == Ending.TIMEOUT) != (truncated & ~terminated),
        "must be 3 TIMEOUT exactly where truncated and not terminated",
    )


def _check_within_episodes(columns: Mapping[str, Any]) -> None:
    same_episode = np.diff(columns["episode"], prepend=-1) == 0
    ended_before = np.concatenate([[False], columns["ending"][:-1] != Ending.NONE])
    _refuse(
        "episode",
        same_episode & ended_before,
        "follows an end inside its episode: begin a new episode there",
    )
    other_mode = np.diff(columns["mode"], prepend=columns["mode"][:1]) != 0
    _refuse(
        "mode",
        same_episode & other_mode,
        "changes inside an episode: give all its rows one demonstrator",
    )


def _check_steps(columns: Mapping[str, Any]) -> None:
    step, same_episode = columns["step"], np.diff(columns["episode"], prepend=-1) == 0
    _refuse("step", step < 0, "negative: number the steps of an episode from 0")
    _refuse(
        "step",
        same_episode & (np.diff(step, prepend=-1) <= 0),
        "does not increase within its episode: keep an episode's rows in order",
    )
