"""Layout of a report's pictures: the trade-off of the rewards, and the dial of angles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

_MARGIN = 0.06  # of the span, left free on every side

_STEPS = (1.0, 2.0, 5.0, 10.0)


class Box(NamedTuple):
    """Position of a picture's axes in its units; y points down."""

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
        box: Position of the axes.
        low: Smallest x and y shown.
        factor: Units of the picture for each unit of reward.
    """

    box: Box
    low: tuple[float, float]
    factor: float

    @staticmethod
    def over(points: Sequence[tuple[float, float]], box: Box) -> Scale:
        """Return the largest scale with all points inside, centred."""
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
        """Return round numbers along an axis: 0 for x, 1 for y."""
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
    """Return the smallest of 1, 2, 5 times a power of ten that is not below a number."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return power * next(step for step in _STEPS if step * power >= wanted * (1 - 1e-9))


def path(points: Sequence[tuple[float, float]], closed: bool = False) -> str:
    """Return straight lines through places as an SVG path."""
    text = "M" + " L".join(f"{x:g} {y:g}" for x, y in points)
    return text + " Z" if closed else text


WIDTH, HEIGHT = 360, 300

_BOX = Box(44, 10, 352, 258)

_ROUND = 72  # points of an ellipse

Point = tuple[float, float]


@dataclass(frozen=True)
class Mark:
    """A reference: its number in the table, and its place."""

    number: int
    x: float
    y: float


@dataclass(frozen=True)
class Panel:
    """One picture, in units of its view box.

    Attributes:
        box: Position of the axes.
        x_ticks: Numbers below.
        y_ticks: Numbers on the left.
        zero: Place of (0, 0), or None if it is outside.
        mean: Place of the policy's mean.
        marks: References.
        front: Path through the best references for angles from 0 to 90 degrees.
        ellipse: Path of the confidence ellipse of the mean.
        arrow: From and to: the declared direction.
        cloud: Places of single episodes.
    """

    box: Box
    x_ticks: list[Tick]
    y_ticks: list[Tick]
    zero: Point | None
    mean: Point
    marks: tuple[Mark, ...] = ()
    front: str = ""
    ellipse: str = ""
    arrow: tuple[Point, Point] | None = None
    cloud: tuple[Point, ...] = ()


def means(report: Mapping[str, Any]) -> Panel:
    """Return the means of the policy and all references, with the declared direction."""
    region = _ellipse(report["tests"]["identifiability"])
    references = [_of(row) for row in report["references"]]
    mean, angle = _of(report["policy"]["means"]), report["declaration"]["angle"]
    points = [*references, *region, mean, (0.0, 0.0)]
    scale = Scale.over(points, _BOX)
    reach = 0.42 * max(math.hypot(*one) for one in points)
    tip = (
        reach * math.cos(math.radians(angle)),
        reach * math.sin(math.radians(angle)),
    )
    tip = _inside(scale, tip)
    return _panel(
        scale,
        mean,
        marks=tuple(Mark(row, *scale.at(*one)) for row, one in enumerate(references, 1)),
        front=path([scale.at(*one) for one in front(references)]),
        ellipse=path([scale.at(*one) for one in region], closed=True),
        arrow=(scale.at(0.0, 0.0), scale.at(*tip)),
    )


def episodes(report: Mapping[str, Any]) -> Panel:
    """Return single episodes of the policy around their mean."""
    cloud = [(float(env), float(social)) for env, social in report["cloud"]]
    mean = _of(report["policy"]["means"])
    scale = Scale.over([*cloud, mean], _BOX)
    return _panel(scale, mean, cloud=tuple(scale.at(*one) for one in cloud))


def front(points: Sequence[Point]) -> list[Point]:
    """Return the points that are best at angles from 0 to 90 degrees, in the order of angles."""
    best: list[Point] = []
    for degrees in range(91):
        env, social = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        # Where one weight is 0, ties are broken by the other reward.
        one = max(points, key=lambda point: env * point[0] + social * point[1] + 1e-9 * sum(point))
        if one not in best:
            best.append(one)
    return best


def _panel(scale: Scale, mean: Point, **parts: Any) -> Panel:
    x, y = zero = scale.at(0.0, 0.0)
    box = scale.box
    seen = box.left <= x <= box.right and box.top <= y <= box.bottom
    return Panel(
        box=box,
        x_ticks=scale.ticks(0, 7),
        y_ticks=scale.ticks(1, 7),
        zero=zero if seen else None,
        mean=scale.at(*mean),
        **parts,
    )


def _inside(scale: Scale, tip: Point) -> Point:
    """Return the tip, moved inside the axes."""
    box = scale.box
    for _ in range(200):
        x, y = scale.at(*tip)
        if box.left + 4 <= x <= box.right - 4 and box.top + 4 <= y <= box.bottom - 4:
            break
        tip = (0.97 * tip[0], 0.97 * tip[1])
    return tip


def _ellipse(region: Mapping[str, Any]) -> list[Point]:
    tilt = math.radians(region["tilt"])
    points = []
    for step in range(_ROUND):
        turn = 2 * math.pi * step / _ROUND
        along, across = region["major"] * math.cos(turn), region["minor"] * math.sin(turn)
        env = region["env"] + along * math.cos(tilt) - across * math.sin(tilt)
        points.append((env, region["social"] + along * math.sin(tilt) + across * math.cos(tilt)))
    return points


def _of(row: Mapping[str, Any]) -> Point:
    return float(row["r_env"]), float(row["r_social"])


_CENTRE = (180.0, 150.0)

_BAND, _INNER = 92.0, 66.0  # radii of the band of arcs, and of the needle's interval

_NEARLY_ALL = 359.99  # SVG draws no arc that ends where it begins


@dataclass(frozen=True)
class DialPicture:
    """Paths in the picture's units.

    Attributes:
        ring: The whole circle.
        possibly: Arcs that can't be excluded.
        arcs: Arcs by the estimates.
        surely: Significant arcs.
        declared: From and to: a line across the band.
        declared_label: Position of its label.
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
        """Centre of the circle."""
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
    """Return the labels of the quarters, without one that overlaps the declared angle's."""
    quarters = [(0.0, "0°"), (90.0, "90°"), (180.0, "180°"), (270.0, "270°")]
    return [one for one in quarters if 25 < (angle - one[0]) % 360 < 335]


def _place(radius: float, degrees: float) -> Point:
    """Return the place on a circle; 0 degrees points to the right, 90 upwards."""
    turn = math.radians(degrees)
    x, y = _CENTRE[0] + radius * math.cos(turn), _CENTRE[1] - radius * math.sin(turn)
    return round(x, 2), round(y, 2)


def _arc(radius: float, low: float, high: float) -> str:
    """Return an arc counter-clockwise as an SVG path."""
    span = min(high - low, _NEARLY_ALL)
    (x, y), (to_x, to_y) = _place(radius, low), _place(radius, low + span)
    large = int(span > 180)
    return f"M{x:g} {y:g} A{radius:g} {radius:g} 0 {large} 0 {to_x:g} {to_y:g}"
