"""Column maps of CSV files of steps: which column holds what, its scale, its words.

A map is a TOML file. As in maps of recordings, `[columns]` has the file's columns by our names.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from socialiq.datasets.step_tables import STEPS
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.reading import check_keys, read_toml
from socialiq.worlds.wrapper import flat_rows, flat_space

TABLES = ("columns", "scales", "words")


class ColumnMap(NamedTuple):
    """Description of the columns of a CSV file of steps."""

    names: dict[str, str]  # our names, in the form of `STEPS`, by the file's
    scales: Mapping[str, float]  # factor of a column by its name in the file; -1 turns the sign
    # words of a column in the order of their numbers, or these numbers; in observations one-hot
    words: Mapping[str, Sequence[Any]]

    def number_of(self, column: str, cell: str) -> int:
        """Return the number of a word of a column; `ValueError` for another word."""
        words = self.words[column]
        return words.index(int(cell) if isinstance(words, range) else cell)

    def applied(self, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return columns with their scales, and words of observations as one-hot vectors.

        Args:
            columns: Columns by our names.
        """
        results = dict[str, np.ndarray]()
        counts = Counter[str]()
        for column, name in self.names.items():
            values = columns[name]
            if column in self.scales:
                values = values * self.scales[column]
            vector = name.rpartition("_")[0]
            features = values[:, None]
            if column in self.words and vector in STEPS.vectors:
                space = spaces.Discrete(len(self.words[column]))
                flat_space(space)  # refuses too many values
                features = flat_rows(space, features)
            for feature in features.T:
                numbered = f"{vector}_{counts[vector]}" if vector in STEPS.vectors else name
                results[numbered] = feature
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
        columns, scales, words = (content.get(table, {}) for table in TABLES)
        names = dict[str, str]()
        for name, value in columns.items():
            several = value if isinstance(value, list) else [value]
            is_vector = several is value or name in STEPS.vectors
            ours = [f"{name}_{number}" if is_vector else name for number in range(len(several))]
            if None in map(STEPS.kind_of, ours):
                known = (*STEPS.vectors, STEPS.action, *STEPS.scalars)
                raise UserError(f"[columns] {one_line(name, 40)}: known are {', '.join(known)}")
            names |= dict(zip(several, ours, strict=True))
        for table in TABLES[1:]:
            check_keys(table, content.get(table, {}), names)
        factors = {column: float(factor) for column, factor in scales.items()}
        values = {key: range(word) if type(word) is int else word for key, word in words.items()}
        return ColumnMap(names, factors, values)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    except (AttributeError, TypeError, ValueError) as error:
        raise UserError(
            f"{path} must have tables: columns of names, scales of numbers, words of lists or sizes"
        ) from error
