"""The dial: which angles would explain the driving, and where the declared one lies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

WIDTH, HEIGHT = 360, 300
_CENTRE = (180.0, 150.0)
_BAND, _INNER = 92.0, 66.0  # radii of the band of arcs, and of the needle's interval
_NEARLY_ALL = 359.99  # SVG draws no arc that ends where it begins

Point = tuple[float, float]


@dataclass(frozen=True)
class DialPicture:
    """Paths in the picture's own units.

    Attributes:
        ring: The whole circle.
        possibly: Arcs that can't be excluded.
        arcs: Arcs by the estimates.
        surely: Arcs that are shown.
        declared: From and to: a line across the band.
        declared_label: Where its label stands.
        needle: Tip of α̂'s needle, or None.
        interval: Arc of α̂'s interval, or "".
        marks: Places and texts around.
    """

    ring: str
    possibly: tuple[str, ...]
    arcs: tuple[str, ...]
    surely: tuple[str, ...]
    declared: tuple[Point, Point]
    declared_label: Point
    needle: Point | None
    interval: str
    marks: tuple[tuple[Point, str], ...]

    @property
    def centre(self) -> Point:
        """Of the circle."""
        return _CENTRE


def dial(report: Mapping[str, Any]) -> DialPicture:
    """Lay out the dial of a report."""
    tests = report["tests"]
    angle, found, shown = report["declaration"]["angle"], tests["rationalised"], tests["alpha_hat"]
    sets = {
        name: tuple(_arc(_BAND, one["low"], one["high"]) for one in found[name])
        for name in ("possibly", "arcs", "surely")
    }
    return DialPicture(
        ring=_arc(_BAND, 0.0, 360.0),
        **sets,
        declared=(_place(_BAND - 16, angle), _place(_BAND + 16, angle)),
        declared_label=_place(_BAND + 30, angle),
        needle=_place(_INNER - 8, shown["angle"]) if shown else None,
        interval=_arc(_INNER, shown["low"], shown["high"]) if shown else "",
        marks=tuple((_place(_BAND + 34, degrees), text) for degrees, text in _marks(angle)),
    )


def _marks(angle: float) -> list[tuple[float, str]]:
    """The quarters, but for one that the declared angle's own label would cover."""
    quarters = [(0.0, "0°"), (90.0, "90°"), (180.0, "180°"), (270.0, "270°")]
    return [one for one in quarters if 25 < (angle - one[0]) % 360 < 335]


def _place(radius: float, degrees: float) -> Point:
    """0 degrees points to the right, 90 upwards."""
    turn = math.radians(degrees)
    x, y = _CENTRE[0] + radius * math.cos(turn), _CENTRE[1] - radius * math.sin(turn)
    return round(x, 2), round(y, 2)


def _arc(radius: float, low: float, high: float) -> str:
    """An arc counter-clockwise, as SVG writes it."""
    span = min(high - low, _NEARLY_ALL)
    (x, y), (to_x, to_y) = _place(radius, low), _place(radius, low + span)
    large = int(span > 180)
    return f"M{x:g} {y:g} A{radius:g} {radius:g} 0 {large} 0 {to_x:g} {to_y:g}"
