"""Arcs of angles: complements on the circle, and arcs of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool


@dataclass(frozen=True)
class Arc:
    """Arc from `low` in [0, 360) counter-clockwise to `high`, at most 360 further; degrees."""

    low: float
    high: float

    def holds(self, angle: float) -> bool:
        """Whether an angle is on the arc, including its ends."""
        return (angle - self.low) % 360.0 <= self.high - self.low


def complement(centres: Sequence[float], halves: Sequence[float]) -> tuple[Arc, ...]:
    """Return the complement on the circle of open arcs, each a centre and a half-width in degrees.

    Returns:
        Closed arcs in the order of their low ends; the whole circle is an arc from 0 to 360.
    """
    spans = sorted(
        ((centre - half) % 360.0, 2.0 * half)
        for centre, half in zip(centres, halves, strict=True)
        if half > 0.0
    )
    if not spans:
        return (Arc(0.0, 360.0),)
    free = []
    reached = max(low + width for low, width in spans) - 360.0  # end of the arcs that wrap round
    for low, width in spans:
        if low >= reached:
            free.append((reached, low))
        reached = max(reached, low + width)
    arcs = [Arc(low % 360.0, low % 360.0 + high - low) for low, high in free]
    return tuple(sorted(arcs, key=lambda arc: arc.low))


def arcs_of_grid(inside: Bool[np.ndarray, " angle"], step: float) -> tuple[Arc, ...]:
    """Return the arcs of neighbouring grid angles that are inside a set.

    Args:
        inside: Whether each of the angles 0, step, 2 step, ... below 360 is inside.
        step: Step of the grid, degrees.
    """
    if inside.all():
        return (Arc(0.0, 360.0),)
    turned = np.roll(inside, -1)
    ends = np.flatnonzero(inside & ~turned)
    starts = np.flatnonzero(~inside & turned) + 1
    arcs = []
    for start in (starts % len(inside)).tolist():
        length = int(((ends - start) % len(inside)).min())
        arcs.append(Arc(start * step, (start + length) * step))
    return tuple(sorted(arcs, key=lambda arc: arc.low))
