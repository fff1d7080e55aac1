"""Flat columns of CSV and Parquet files: one row for each step, one column for each number.

A vector takes one column for each feature: `observation_0`, `observation_1`, ... (docs/files.md).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line

Kind = Literal["number", "integer", "flag"]
"""Content of a column's cells."""


class Layout(NamedTuple):
    """Columns of a kind of file.

    Attributes:
        vectors: Columns of one number for each feature, NAME_0, NAME_1, ...: of the observation
            and of the next one.
        action: Column of discrete actions; continuous ones take NAME_0, NAME_1, ...
        scalars: All other columns; among them `r_env` and `r_social`.
        reward: The column instead of these two, for a reward of one number a step.
        required: Columns that a file must have beside a reward and actions.
    """

    vectors: tuple[str, str]
    action: str
    scalars: Mapping[str, Kind]
    reward: str
    required: tuple[str, ...]

    def kind_of(self, name: str) -> Kind | None:
        """Return what the cells of a column hold, or None for an unknown column."""
        if self._feature(name):
            return "number"
        return "integer" if name == self.action else self.scalars.get(name)

    def check_names(self, names: Sequence[str], source: str) -> None:
        """Refuse a header that is not that of this layout.

        Args:
            names: The columns of the file.
            source: The file's name in messages.

        Raises:
            UserError: If a column is unknown, twice there or missing; the line names it.
        """
        for name in names:
            if self.kind_of(name) is None:
                vectors = (f"{vector}_0, ..." for vector in (*self.vectors, self.action))
                known = ", ".join((*vectors, self.action, *self.scalars))
                raise UserError(
                    f"{source} has an unknown column '{one_line(name, 60)}': remove or rename it; "
                    f"known are {known}"
                )
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise UserError(f"{source} has two columns {twice}: leave one")
        self._check_features(names, source)
        alone = self.reward in names
        missing = [name for name in self.required if name not in names]
        continuous = f"{self.action}_0" in names
        missing += [self.action] if self.action not in names and not continuous else []
        missing += [name for name in ("r_env", "r_social") if name not in names and not alone]
        if missing:
            raise UserError(
                f"{source} has no column {', '.join(missing)}: add it; a reward of one number a "
                f"step is a column {self.reward}, instead of r_env and r_social"
            )
        if continuous and self.action in names:
            raise UserError(
                f"{source} has {self.action} beside {self.action}_0: leave one or the other"
            )
        if alone and ("r_env" in names or "r_social" in names):
            raise UserError(
                f"{source} has {self.reward} beside r_env and r_social: leave one or the other"
            )

    def arrays_of(self, columns: Mapping[str, np.ndarray], source: str) -> dict[str, np.ndarray]:
        """Return arrays by name, with vectors and the reward pair in one array each.

        Args:
            columns: One-dimensional arrays under the names of a file.
            source: The file's name in messages.

        Raises:
            UserError: If a header is wrong, or a number is not finite; the line names column and
                row.
        """
        self.check_names(list(columns), source)
        for name, column in columns.items():
            if column.dtype.kind == "f" and not (finite := np.isfinite(column)).all():
                raise UserError(
                    f"{source}: column {name}, row {int(np.argmin(finite))}: not finite: leave out "
                    "the episode, or correct its recording"
                )
        others = (*self.scalars, self.action)
        arrays = {name: column for name, column in columns.items() if name in others}
        for vector in (*self.vectors, self.action):
            if size := len(self._features(list(columns), vector)):
                arrays[vector] = np.stack([columns[f"{vector}_{one}"] for one in range(size)], 1)
        if self.reward not in columns:
            pair = arrays.pop("r_env"), arrays.pop("r_social")
            arrays[self.reward] = np.stack(pair, axis=1)
        return arrays

    def _feature(self, name: str) -> re.Match[str] | None:
        return re.fullmatch(
            rf"({'|'.join((*self.vectors, self.action))})_(0|[1-9][0-9]{{0,8}})", name
        )

    def _features(self, names: Sequence[str], vector: str) -> list[int]:
        """Return the numbers of the features that have a column, in rising order."""
        found = (self._feature(name) for name in names)
        return sorted(int(one[2]) for one in found if one and one[1] == vector)

    def _check_features(self, names: Sequence[str], source: str) -> None:
        vectors = (*self.vectors, self.action)
        sizes = {vector: self._features(names, vector) for vector in vectors}
        for vector, numbers in sizes.items():
            gap = next((place for place, number in enumerate(numbers) if place != number), None)
            if gap is not None:
                raise UserError(
                    f"{source} has {vector}_{numbers[-1]} but no column {vector}_{gap}: number the "
                    "columns 0, 1, 2, ..."
                )
        observed, following = (len(sizes[vector]) for vector in self.vectors)
        if following and observed != following:
            now, after = self.vectors
            raise UserError(
                f"{source} has {observed} columns {now}_0, ... and {following} columns "
                f"{after}_0, ...: give both as many"
            )


STEPS = Layout(
    vectors=("observation", "next_observation"),
    action="action",
    scalars={
        "reward": "number",
        "r_env": "number",
        "r_social": "number",
        "terminated": "flag",
        "truncated": "flag",
        "ending": "integer",
        "mode": "integer",
        "episode": "integer",
        "step": "integer",
    },
    reward="reward",
    required=("observation_0",),
)
"""Demonstrations, under the names of `arrays.of_steps`."""


def columns_of(table: Demonstrations) -> dict[str, np.ndarray]:
    """Return every column of a table under its name in `STEPS`, in a file's order."""
    found: dict[str, Any] = {}
    for name, array in table.arrays().items():
        if array.ndim == 2:
            found |= {f"{name}_{place}": column for place, column in enumerate(array.T)}
        else:
            found[name] = array
    return found
