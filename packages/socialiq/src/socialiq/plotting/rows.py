"""Rows of a table as lines, and as means with a band from the least to the largest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq.types import Row


def line(axes: Any, rows: Sequence[Row], x: str, y: str, **style: Any) -> None:
    """Draw one column of the rows against another, in the order of the rows."""
    axes.plot([row[x] for row in rows], [row[y] for row in rows], **style)


def spread(rows: Sequence[Row], x: str, y: str) -> tuple[np.ndarray, ...]:
    """Return the distinct values of a column, and mean, least and largest of another at each."""
    places = sorted({row[x] for row in rows})
    values = [[row[y] for row in rows if row[x] == number] for number in places]
    return (
        np.array(places),
        np.array([np.mean(group) for group in values]),
        np.array([min(group) for group in values]),
        np.array([max(group) for group in values]),
    )


def band(axes: Any, rows: Sequence[Row], x: str, y: str, factor: float = 1.0, **style: Any) -> None:
    """Draw mean and range of a column over rows of equal `x`, for instance over training seeds.

    Args:
        axes: Where to draw.
        rows: Rows of a table.
        x: Column of the horizontal axis.
        y: Column of the vertical axis.
        factor: Multiplier of `y`; 100 turns shares into percent.
        **style: Options of the line; the band has its colour.
    """
    places, mean, low, high = spread(rows, x, y)
    light = {"color": style["color"], "alpha": 0.15, "linewidth": 0}
    axes.fill_between(places, factor * low, factor * high, **light)
    axes.plot(places, factor * mean, **({"markersize": 4} | style))
