"""Road network of a recording: lanelets, their connections, and right of way.

The frame is that of `tracks`: metres, x to the east, y to the north.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from jaxtyping import Float64

from socialiq.errors import UserError


class Sign(enum.IntEnum):
    """Right-of-way sign of a lanelet; NONE if the file has none."""

    NONE = 0
    PRIORITY = 1
    YIELD = 2
    STOP = 3
    LIGHT = 4


@dataclass(frozen=True, eq=False)
class Lanelet:
    """Section of a lane, driven from the first points of its bounds to the last.

    Attributes:
        identity: Number of the lanelet in the file.
        left: Left bound, in driving direction.
        right: Right bound, with the same number of points.
        successors: Lanelets that it leads to.
        predecessors: Lanelets that lead to it.
        adjacent_left: The lanelet to its left, and whether it has the same direction.
        adjacent_right: The same to its right.
        speed_limit: m/s; infinity if unknown.
        sign: Right of way.
        stop_line: Two points, if the file has a stop line.

    Raises:
        UserError: If a bound has fewer than two points, the numbers differ, or a coordinate
            isn't finite.
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

    # Run-time type checkers leave the constructor to `__post_init__`, whose lines say what to do.
    __no_type_check__: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the bounds."""
        left, right = np.asarray(self.left), np.asarray(self.right)
        if left.ndim != 2 or left.shape != right.shape or len(left) < 2 or left.shape[1] != 2:
            raise UserError(
                f"lanelet {self.identity}: its bounds have {len(left)} and {len(right)} points: "
                "give both as many, two or more, each (x, y)"
            )
        if not (np.isfinite(left).all() and np.isfinite(right).all()):
            raise UserError(f"lanelet {self.identity}: a point of its bounds is not finite")

    @property
    def centre(self) -> Float64[np.ndarray, "point 2"]:
        """Centre line: the midpoints of the bounds."""
        return (self.left + self.right) / 2


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """Lanelets of a road, by their numbers.

    Attributes:
        lanelets: Lanelets in the order of the file.
    """

    lanelets: dict[int, Lanelet] = field(default_factory=dict)
