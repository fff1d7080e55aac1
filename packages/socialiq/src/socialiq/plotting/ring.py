"""Empirical angles on a ring, as the thesis draws them (Figs 6.2 and 6.5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, MARKS, figure

_OUTSIDE = 1.14  # radius of the thesis' marks
_ARC, _ARC_STEP = 0.95, 0.015  # radii of the first arc, and from one to the next


class Mark(NamedTuple):
    """A policy on the ring; angles in degrees.

    Attributes:
        name: Key of its colour and mark.
        angle: Our angle.
        label: Text of its legend entry.
        thesis: The thesis' angle, if it prints one.
        spread: Ends of an arc, counterclockwise.
    """

    name: str
    angle: float
    label: str
    thesis: float | None = None
    spread: tuple[float, float] | None = None


def ring(marks: Sequence[Mark], title: str) -> Figure:
    """Draw our angles on the ring, spreads as arcs inside, the thesis' as open marks outside."""
    selected = figure(6.4, 6.0)
    axes = selected.add_subplot()
    axes.plot(*_arc(0.0, 360.0, 1.0), color="#cccccc", linewidth=1.2)
    for degrees in range(0, 360, 45):
        x, y = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        axes.text(0.82 * x, 0.82 * y, f"{degrees}°", ha="center", va="center", color="#888888")
    for number, mark in enumerate(marks):
        if mark.spread is not None:
            arc = _arc(*mark.spread, _ARC - number * _ARC_STEP)
            axes.plot(*arc, color=COLORS[mark.name], linewidth=2.2, solid_capstyle="round")
        # Another mark may cover the baseline's, which is larger so that both are visible.
        size = 15 if mark.name == "baseline" else 10
        _mark(axes, mark.name, mark.angle, 1.0, size, COLORS[mark.name], mark.label)
        if mark.thesis is not None:
            _mark(axes, mark.name, mark.thesis, _OUTSIDE, 8, "none", None)
    axes.set(xlim=(-1.35, 1.35), ylim=(-1.35, 1.35), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.spines[:].set_visible(False)
    axes.set_xlabel("r_env →")
    axes.set_ylabel("r_social →")
    axes.legend(loc="center", frameon=False, fontsize=8)
    axes.set_title(title, fontsize=10)
    return selected


def _arc(low: float, high: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    around = np.radians(np.linspace(low, high, 361))
    return radius * np.cos(around), radius * np.sin(around)


def _mark(
    axes: Any, name: str, degrees: float, radius: float, size: int, face: str, label: str | None
) -> None:
    x, y = radius * np.cos(np.radians(degrees)), radius * np.sin(np.radians(degrees))
    style = {"marker": MARKS[name], "markersize": size, "markeredgecolor": COLORS[name]}
    axes.plot([x], [y], linestyle="none", markerfacecolor=face, label=label, **style)
