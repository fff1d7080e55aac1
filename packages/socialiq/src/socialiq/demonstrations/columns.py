"""Layout of the columns of a demonstrations table, and the checks that make them one table.

A message names the column, its first bad row and the correction. Later checks rely on earlier
ones, so the order here is the order of the messages.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
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
    """
    action = columns["action"]
    is_vector = isinstance(action, np.ndarray) and action.dtype.kind == "f" and action.ndim == 2
    continuous = type(n_actions) is int and n_actions == 0 and is_vector
    # bool is an int to Python, and a NumPy integer would not go into a file's JSON header.
    if not continuous and (type(n_actions) is not int or n_actions < 1):
        raise UserError(f"n_actions is {n_actions!r}: pass a Python int of at least 1")
    if not isinstance(mode_names, tuple) or not all(
        isinstance(name, str) and name for name in mode_names
    ):
        raise UserError("mode_names must be a tuple of non-empty strings")
    if len(set(mode_names)) < len(mode_names) or len(mode_names) > np.iinfo(np.int8).max:
        raise UserError("mode_names must be distinct, and at most 127: merge or rename modes")
    check_layout(
        columns, LAYOUT | {"action": (np.float32, 2)} if continuous else LAYOUT, "transition"
    )
    features, next_features = (
        columns[name].shape[1] for name in ("observation", "next_observation")
    )
    if features != next_features:
        raise UserError(
            f"column next_observation has {next_features} features where observation has "
            f"{features}: encode both the same way"
        )
    for name, bad, problem in _faults(columns, n_actions, len(mode_names)):
        if bad.any():
            raise UserError(f"column {name}, row {int(np.argmax(bad))}: {problem}")


def check_layout(
    columns: Mapping[str, Any], layout: Mapping[str, tuple[type[np.generic], int]], what: str
) -> None:
    """Refuse columns of other types, axes or lengths than a layout's.

    Args:
        columns: Columns by name.
        layout: Type and number of axes of each column, by name.
        what: Name of a row in messages.

    Raises:
        UserError: The line names the column and the remedy.
    """
    first = "action" if "action" in layout else next(iter(layout))
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
    count = len(columns[first])
    if count == 0:
        raise UserError(f"column {first} has no rows: pass at least one {what}")
    for name in layout:
        if len(columns[name]) != count:
            raise UserError(
                f"column {name} has {len(columns[name])} rows where {first} has {count}: "
                f"pass one row per {what}"
            )


def _faults(
    columns: Mapping[str, Any], n_actions: int, n_modes: int
) -> Iterator[tuple[str, np.ndarray, str]]:
    """Yield the name of a column, whether each row is bad, and the correction."""
    for name, column in columns.items():
        if column.dtype.kind == "f":
            bad = ~np.isfinite(column).reshape(len(column), -1).all(axis=1)
            yield name, bad, "not finite: leave out the episode, or correct its recording"
    action = columns["action"]
    mode = columns["mode"]
    episode = columns["episode"]
    if action.ndim == 2:
        if action.shape[1] == 0:
            raise UserError(
                "column action has rows without a number: pass one or more for each row"
            )
        outside = np.abs(action).max(axis=1) > 1.0
        yield "action", outside, "outside [-1, 1]: scale actions by the bounds of their space"
    ranges = [("action", n_actions, "n_actions"), ("mode", n_modes, "the number of mode_names")]
    for name, size, what in ranges[action.ndim - 1 :]:
        outside = (columns[name] < 0) | (columns[name] >= size)
        yield name, outside, f"outside [0, {size}): number from 0 and check {what}"
    advance = np.diff(episode, prepend=-1)
    bad = (advance != 0) & (advance != 1)
    bad[0] = episode[0] != 0
    yield "episode", bad, "number episodes 0, 1, 2, ... in order, with their rows adjacent"
    ending, terminated, truncated = (
        columns[name] for name in ("ending", "terminated", "truncated")
    )
    kinds = ", ".join(f"{kind.value} {kind.name}" for kind in Ending)
    unknown = ~np.isin(ending, [int(kind) for kind in Ending])
    yield "ending", unknown, f"not a value of types.Ending: use {kinds}"
    wrong = (ending == Ending.NONE) != (~terminated & ~truncated)
    yield "ending", wrong, "must be 0 NONE exactly where neither terminated nor truncated"
    wrong = (ending == Ending.TIMEOUT) != (truncated & ~terminated)
    yield "ending", wrong, "must be 3 TIMEOUT exactly where truncated and not terminated"
    within = advance == 0
    step = columns["step"]
    ended_before = np.concatenate([[False], ending[:-1] != Ending.NONE])
    problem = "follows an end inside its episode: begin a new episode there"
    yield "episode", within & ended_before, problem
    changes = within & (np.diff(mode, prepend=mode[:1]) != 0)
    yield "mode", changes, "changes inside an episode: give all its rows one demonstrator"
    yield "step", step < 0, "negative: number the steps of an episode from 0"
    problem = "does not increase within its episode: keep an episode's rows in order"
    yield "step", within & (np.diff(step, prepend=-1) <= 0), problem


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
    """Return provenance as a JSON file would give it back: tuples become lists."""
    if not isinstance(source, dict):
        raise UserError(f"source is a {type(source).__name__}: pass a dict of what made the data")
    try:
        return json.loads(json.dumps(source, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise UserError(
            f"source cannot be written as JSON ({error}): keep to strings, finite numbers, "
            "lists and dicts"
        ) from error
