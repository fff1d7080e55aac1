"""Operations on rows that studies share: groups, means, nested summaries, adjusted tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq.statistics.comparisons import holm, paired_difference
from socialiq.types import Row


def groups(rows: Sequence[Row], *keys: str) -> dict[tuple, list[Row]]:
    """Return the rows by their values of some columns, in order of first appearance."""
    found: dict[tuple, list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), []).append(row)
    return found


def matching(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    """Return the rows that have these values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def column(rows: Sequence[Row], name: str) -> list[Any]:
    """Return the values of a column."""
    return [row[name] for row in rows]


def mean(rows: Sequence[Row], name: str) -> float:
    """Return the mean of a column."""
    return float(np.mean(column(rows, name)))


def spread(rows: Sequence[Row], name: str) -> dict[str, float]:
    """Return mean, least and largest value of a column."""
    values = column(rows, name)
    return {"mean": float(np.mean(values)), "low": min(values), "high": max(values)}


def numeric_means(rows: Sequence[Row]) -> Row:
    """Return the means of the columns that are numbers in all rows."""
    names = [name for name in rows[0] if all(isinstance(row[name], int | float) for row in rows)]
    return {name: sum(row[name] for row in rows) / len(rows) for name in names}


def nested(rows: Sequence[Row], *keys: str, keep: Sequence[str] | None = None) -> dict[str, Any]:
    """Return rows as nested mappings by the values of their keys.

    Args:
        rows: Rows; of equal keys the last one stays.
        keys: Columns, outermost first; a float is written as short as it can be.
        keep: Columns that remain; by default all but the keys.
    """
    found: dict[str, Any] = {}
    for row in rows:
        place = found
        for key in keys[:-1]:
            place = place.setdefault(_as_key(row[key]), {})
        names = [name for name in row if name not in keys] if keep is None else keep
        place[_as_key(row[keys[-1]])] = {name: row[name] for name in names}
    return found


def _as_key(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def paired_row(label: Row, first: Sequence[float], second: Sequence[float]) -> Row:
    """Return the test of a difference that is paired over training seeds, as a row."""
    return label | paired_difference(first, second)._asdict()


def with_holm(rows: Sequence[Row]) -> list[Row]:
    """Add p-values that are adjusted by Holm's method over all rows."""
    adjusted = holm([row["p"] for row in rows]) if rows else []
    return [row | {"p_holm": float(p)} for row, p in zip(rows, adjusted, strict=True)]


def paired_differences(
    first: Sequence[Row], second: Sequence[Row], *columns: str, label: str = "metric"
) -> list[Row]:
    """Test the difference of each column between two groups of rows, with Holm's adjustment.

    Args:
        first: A row for each training seed.
        second: Rows of the same seeds, in the same order.
        columns: Columns to compare.
        label: Column that names the compared one.

    Returns:
        A row for each column; none if there is one seed only.
    """
    if len(first) < 2:
        return []
    return with_holm(
        [
            paired_row({label: name}, [row[name] for row in first], [row[name] for row in second])
            for name in columns
        ]
    )
