"""Column maps of CSV files of steps: which column holds what, its scale, its words.

A map is a TOML file. As in maps of recordings, `[columns]` has the file's columns by our names.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from socialiq.datasets.step_tables import STEPS
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import check_keys, read_toml
from socialiq.worlds.wrapper import flat_rows

TABLES = ("columns", "scales", "words", "sizes")


class ColumnMap(NamedTuple):
    """Description of the columns of a CSV file of steps."""

    names: dict[str, str]  # our names, in the form of `STEPS`, by the file's
    scales: Mapping[str, float]  # factor of a column by its name in the file; -1 turns the sign
    words: Mapping[str, list[str]]  # words of a column in the order of their numbers
    sizes: Mapping[str, int]  # number of values of a whole number, which becomes a one-hot vector

    def applied(self, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return columns with their scales, and whole numbers as one-hot vectors.

        Args:
            columns: Columns by our names.

        Raises:
            UserError: If a cell is none of the values that the map gives its column.
        """
        results = dict[str, np.ndarray]()
        counts = dict.fromkeys(STEPS.vectors, 0)
        for column, name in self.names.items():
            values = columns[name]
            values = values * self.scales[column] if column in self.scales else values
            vector = name.rpartition("_")[0]
            if vector not in counts:
                results[name] = values
                continue
            features = values[:, None]
            if column in self.sizes:
                try:
                    whole = values.astype(np.int64)
                    features = flat_rows(
                        spaces.Discrete(self.sizes[column]),
                        whole if (whole == values).all() else values,
                    )
                except ValueError as error:
                    raise UserError(f"column {column} has {error}: correct its size") from error
            for feature in features.T:
                results[f"{vector}_{counts[vector]}"] = feature
                counts[vector] += 1
        return results


def read_map(path: Path) -> ColumnMap:
    """Read a column map.

    Raises:
        UserError: If the file is missing or has an invalid entry; the line names it.
    """
    content = read_toml(path)
    try:
        check_keys("", content, TABLES)
        tables: dict[str, dict[str, Any]] = {name: content.get(name, {}) for name in TABLES}
        names = dict[str, str]()
        for name, column in tables["columns"].items():
            several = column if isinstance(column, list) else [column]
            is_list = isinstance(column, list) or name in STEPS.vectors
            for number, text in enumerate(several):
                ours = f"{name}_{number}" if is_list else name
                if not isinstance(text, str) or STEPS.kind_of(ours) is None or text in names:
                    raise UserError(
                        f"[columns] {one_line(name, 40)} must be a column of its own, or a list of "
                        "them for observation, next_observation and action; known are "
                        f"{', '.join((*STEPS.vectors, STEPS.action, *STEPS.scalars))}"
                    )
                names[text] = ours
        kinds = {"scales": (int, float), "words": (list,), "sizes": (int,)}
        for table, types in kinds.items():
            check_keys(table, tables[table], names)
            for column, value in tables[table].items():
                if type(value) not in types or (table == "sizes" and value < 1):
                    form = {"scales": "a number", "words": "a list of words", "sizes": "a size"}
                    raise UserError(f"[{table}] {one_line(column, 40)} must be {form[table]}")
        return ColumnMap(names, *(tables[name] for name in TABLES[1:]))
    except (UserError, AttributeError, TypeError) as error:
        fault = error if isinstance(error, UserError) else "columns, scales, words must be tables"
        raise UserError(f"{path}: {fault}") from error
