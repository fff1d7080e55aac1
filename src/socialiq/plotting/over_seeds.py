"""Rows over training seeds: a line at the mean, a band from the least to the largest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq.types import Row


def of(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    """The rows that have these values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def spread(rows: Sequence[Row], at: str, name: str) -> tuple[np.ndarray, ...]:
    """Values of the column `at`, and the mean, least and largest of `name` at each."""
    places = sorted({row[at] for row in rows})
    values = [[row[name] for row in rows if row[at] == place] for place in places]
    return (
        np.array(places),
        np.array([np.mean(one) for one in values]),
        np.array([min(one) for one in values]),
        np.array([max(one) for one in values]),
    )


def band(
    axes: Any, rows: Sequence[Row], at: str, name: str, factor: float = 1.0, **look: Any
) -> None:
    """Draw them; `factor` turns shares into percent."""
    places, mean, low, high = spread(rows, at, name)
    light = {"color": look["color"], "alpha": 0.15, "linewidth": 0}
    axes.fill_between(places, factor * low, factor * high, **light)
    axes.plot(places, factor * mean, markersize=4, **look)
