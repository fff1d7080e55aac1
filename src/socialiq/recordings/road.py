"""The road network under a recording: lanelets, how they follow each other, who has to give way.

The frame is that of `tracks`: metres, x to the east, y to the north.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64


class Sign(enum.IntEnum):
    """What tells a lanelet's traffic who goes first; NONE where the file says nothing."""

    NONE = 0
    PRIORITY = 1
    YIELD = 2
    STOP = 3
    LIGHT = 4


@dataclass(frozen=True, eq=False)
class Lanelet:
    """A piece of one lane, driven from the first points of its bounds to the last.

    Attributes:
        identity: Its number in the file.
        left: Left bound, in driving direction.
        right: Right bound, with as many points.
        successors: Lanelets that it leads to.
        predecessors: Lanelets that lead to it.
        adjacent_left: The lanelet beside it, and whether it is driven in the same direction.
        adjacent_right: Likewise.
        speed_limit: m/s; infinity where none is known.
        sign: Who goes first.
        stop_line: Two points, where the file has one.
    """

    identity: int
    left: Float64[np.ndarray, "point 2"]
    right: Float64[np.ndarray, "point 2"]
    successors: tuple[int, ...] = ()
    predecessors: tuple[int, ...] = ()
    adjacent_left: tuple[int, bool] | None = None
    adjacent_right: tuple[int, bool] | None = None
    speed_limit: float = float("inf")
    sign: Sign = Sign.NONE
    stop_line: Float64[np.ndarray, "2 2"] | None = None

    @property
    def centre(self) -> Float64[np.ndarray, "point 2"]:
        """Centre line: the middle of the bounds, point by point."""
        return (self.left + self.right) / 2


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """All lanelets by their numbers.

    Attributes:
        lanelets: In the order of the file.
    """

    lanelets: dict[int, Lanelet] = field(default_factory=dict)
