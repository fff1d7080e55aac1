"""Picture of one state of the 5x5 world."""

from __future__ import annotations

from typing import Any

from socialiq.worlds import drawing

SIZE = 5
ROAD = 2  # row of the ego's road and column of the other's


def draw(axes: Any, _world: Any, state: tuple[int, ...]) -> None:
    """Draw the crossing, the ego (blue, eastbound) and the other (orange, northbound)."""
    x_ego, y_ego, x_other, y_other = (int(value) for value in state)
    drawing.crossing(axes, SIZE, ROAD)
    drawing.vehicle(axes, x_other, y_other, "north", drawing.OTHER)
    drawing.vehicle(axes, x_ego, y_ego, "east", drawing.EGO)
