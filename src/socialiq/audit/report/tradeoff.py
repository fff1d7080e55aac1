"""The trade-off picture: the policy among its references, and its single episodes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from socialiq.audit.report.scale import Box, Scale, Tick, path

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
    """One picture, in its own units.

    Attributes:
        box: Of the axes.
        x_ticks: Numbers below.
        y_ticks: Numbers on the left.
        zero: Place of (0, 0), or None if it is out of sight.
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
    """Means of the policy and of all references, with the declared direction."""
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
    """Single episodes of the policy around their mean."""
    cloud = [(float(env), float(social)) for env, social in report["cloud"]]
    mean = _of(report["policy"]["means"])
    scale = Scale.over([*cloud, mean], _BOX)
    return _panel(scale, mean, cloud=tuple(scale.at(*one) for one in cloud))


def front(points: Sequence[Point]) -> list[Point]:
    """Those that are best at some angle from 0 to 90 degrees, in the order of these angles."""
    best: list[Point] = []
    for degrees in range(91):
        env, social = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        # Where one weight is 0 the other reward decides, however little.
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
    """The tip drawn back to the axes, if it lies beyond them."""
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
