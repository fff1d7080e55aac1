"""Picture of one state of the 7x7 world."""

from __future__ import annotations

from typing import Any

from socialiq.worlds import drawing
from socialiq.worlds.crossing7.rules import ABSENT, CONFLICT

SIZE = 7


def draw(axes: Any, _world: Any, state: tuple[int, ...]) -> None:
    """Draw the crossing, the ego (blue, eastbound) and up to two vehicles (orange, northbound).

    A vehicle's number of chevrons is its speed level; a bar across its front is speed 0.
    """
    x_ego, v_ego, y_1, v_1, y_2, v_2 = (int(value) for value in state)
    drawing.crossing(axes, SIZE, CONFLICT)
    for y, v in ((y_1, v_1), (y_2, v_2)):
        if y != ABSENT:
            drawing.vehicle(axes, CONFLICT, y, "north", drawing.OTHER, v)
    drawing.vehicle(axes, x_ego, CONFLICT, "east", drawing.EGO, v_ego)
