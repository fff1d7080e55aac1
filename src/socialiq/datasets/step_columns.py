"""Demonstrations as flat columns, one row for each transition, as CSV and Parquet hold them.

A vector takes one column for each feature: `observation_0`, `observation_1`, ... (docs/files.md).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line

Kind = Literal["number", "integer", "flag"]
"""Content of a column's cells."""

VECTORS = ("observation", "next_observation")
"""Columns of one number for each feature, NAME_0, NAME_1, ..."""

SCALARS: dict[str, Kind] = {
    "action": "integer",
    "reward": "number",
    "r_env": "number",
    "r_social": "number",
    "terminated": "flag",
    "truncated": "flag",
    "ending": "integer",
    "mode": "integer",
    "episode": "integer",
    "step": "integer",
}
"""All other columns."""

_FEATURE = re.compile(rf"({'|'.join(VECTORS)})_(0|[1-9][0-9]{{0,8}})")


def kind_of(name: str) -> Kind | None:
    """Return what the cells of a column hold, or None for an unknown column."""
    return "number" if _FEATURE.fullmatch(name) else SCALARS.get(name)


def check_names(names: Sequence[str], source: str) -> None:
    """Refuse a header that is not that of a table of steps.

    Args:
        names: The columns of the file.
        source: The file's name in messages.

    Raises:
        UserError: If a column is unknown, twice there or missing; the line names it.
    """
    for name in names:
        if kind_of(name) is None:
            known = ", ".join((*(f"{vector}_0, ..." for vector in VECTORS), *SCALARS))
            raise UserError(
                f"{source} has an unknown column '{one_line(name, 60)}': remove or rename it; "
                f"known are {known}"
            )
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(f"{source} has two columns {twice}: leave one")
    _check_features(names, source)
    missing = [name for name in ("observation_0", "action") if name not in names]
    missing += [name for name in ("r_env", "r_social") if name not in names and not _lone(names)]
    if missing:
        raise UserError(
            f"{source} has no column {', '.join(missing)}: add it; a reward of one number a step "
            "is a column reward, instead of r_env and r_social"
        )
    if _lone(names) and ("r_env" in names or "r_social" in names):
        raise UserError(f"{source} has reward beside r_env and r_social: leave one or the other")


def _lone(names: Sequence[str]) -> bool:
    return "reward" in names


def _check_features(names: Sequence[str], source: str) -> None:
    sizes = {vector: _features(names, vector) for vector in VECTORS}
    for vector, numbers in sizes.items():
        gap = next((place for place, number in enumerate(numbers) if place != number), None)
        if gap is not None:
            raise UserError(
                f"{source} has {vector}_{numbers[-1]} but no column {vector}_{gap}: number the "
                "features 0, 1, 2, ..."
            )
    observed, following = (len(sizes[vector]) for vector in VECTORS)
    if following and observed != following:
        raise UserError(
            f"{source} has {observed} columns observation_0, ... and {following} columns "
            "next_observation_0, ...: give both as many"
        )


def _features(names: Sequence[str], vector: str) -> list[int]:
    """The numbers of the features that have a column, in rising order."""
    found = (_FEATURE.fullmatch(name) for name in names)
    return sorted(int(one[2]) for one in found if one and one[1] == vector)


def arrays_of(columns: Mapping[str, np.ndarray], source: str) -> dict[str, np.ndarray]:
    """Return the arguments of `arrays.of_steps` from checked columns.

    Args:
        columns: One-dimensional arrays under the names of a file.
        source: The file's name in messages.

    Raises:
        UserError: If a header is wrong, or a number is not finite; the line names column and row.
    """
    names = list(columns)
    check_names(names, source)
    for name, column in columns.items():
        if column.dtype.kind == "f" and not (finite := np.isfinite(column)).all():
            raise UserError(
                f"{source}: column {name}, row {int(np.argmin(finite))}: not finite: leave out the "
                "episode, or correct its recording"
            )
    arrays = {name: column for name, column in columns.items() if name in SCALARS}
    for vector in VECTORS:
        if size := len(_features(names, vector)):
            arrays[vector] = np.stack([columns[f"{vector}_{place}"] for place in range(size)], 1)
    if not _lone(names):
        arrays["reward"] = np.stack([arrays.pop("r_env"), arrays.pop("r_social")], axis=1)
    return arrays


def columns_of(table: Demonstrations) -> dict[str, np.ndarray]:
    """Return every column of a table under its flat name, in a file's order."""
    found: dict[str, Any] = {}
    for name, array in table.arrays().items():
        if name in VECTORS:
            found |= {f"{name}_{place}": column for place, column in enumerate(array.T)}
        else:
            found[name] = array
    return found
