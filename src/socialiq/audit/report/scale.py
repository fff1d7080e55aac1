"""From rewards to places on paper: one scale for both axes, so that angles are true."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

_MARGIN = 0.06  # of the span, left free on every side
_STEPS = (1.0, 2.0, 5.0, 10.0)


class Box(NamedTuple):
    """Where a picture's axes lie, in its own units; y points down."""

    left: float
    top: float
    right: float
    bottom: float


class Tick(NamedTuple):
    """A number on an axis and its place."""

    place: float
    label: str


@dataclass(frozen=True)
class Scale:
    """Places of points (x, y).

    Attributes:
        box: Of the axes.
        low: Smallest x and y shown.
        factor: Units of the picture for each unit of reward.
    """

    box: Box
    low: tuple[float, float]
    factor: float

    @staticmethod
    def over(points: Sequence[tuple[float, float]], box: Box) -> Scale:
        """The largest scale that shows all points, centred."""
        wide, high = box.right - box.left, box.bottom - box.top
        lows = [min(axis) for axis in zip(*points, strict=True)]
        highs = [max(axis) for axis in zip(*points, strict=True)]
        spans = [max(high - low, 1e-3) for low, high in zip(lows, highs, strict=True)]
        factor = (1 - 2 * _MARGIN) * min(wide / spans[0], high / spans[1])
        centre = [(low + high) / 2 for low, high in zip(lows, highs, strict=True)]
        return Scale(
            box, (centre[0] - wide / (2 * factor), centre[1] - high / (2 * factor)), factor
        )

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Place of a point."""
        return (
            round(self.box.left + (x - self.low[0]) * self.factor, 2),
            round(self.box.bottom - (y - self.low[1]) * self.factor, 2),
        )

    def ticks(self, axis: int, about: int) -> list[Tick]:
        """Round numbers along an axis: 0 for x, 1 for y."""
        box = self.box
        length = box.right - box.left if axis == 0 else box.bottom - box.top
        low, high = self.low[axis], self.low[axis] + length / self.factor
        step = _round_step((high - low) / about)
        numbers = [step * row for row in range(math.ceil(low / step), math.floor(high / step) + 1)]
        places = [self.at(one, one)[axis] for one in numbers]
        return [
            Tick(place, f"{number + 0.0:g}".replace("-", "−"))
            for place, number in zip(places, numbers, strict=True)
        ]


def _round_step(wanted: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that is not below what is wanted."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return power * next(step for step in _STEPS if step * power >= wanted * (1 - 1e-9))


def path(points: Sequence[tuple[float, float]], closed: bool = False) -> str:
    """Straight lines through places, as SVG writes them."""
    text = "M" + " L".join(f"{x:g} {y:g}" for x, y in points)
    return text + " Z" if closed else text
