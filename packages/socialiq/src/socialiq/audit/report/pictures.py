"""Layout of a report's pictures: means of drivers, single episodes, and regret at every angle.

The first two have one scale, and a unit of reward is as long upwards as to the right: angles are
true.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from socialiq.physics import wrapped
from socialiq.types import Json

Point = tuple[float, float]

_MARGIN = 0.06  # of the span, left free on every side


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
    """Places of points (x, y) in a box, above the smallest x and y, by a factor of each axis."""

    box: Box
    low: Point
    factor: Point

    @staticmethod
    def over(points: Sequence[Point], box: Box) -> Scale:
        """Return the largest scale with all points inside, centred.

        Args:
            points: Points (x, y) in units of reward.
            box: Position of the axes in the picture.
        """
        size = np.array([box.right - box.left, box.bottom - box.top])
        lows = np.min(points, axis=0)
        highs = np.max(points, axis=0)
        spans = np.maximum(highs - lows, 1e-3)
        factor = float((1 - 2 * _MARGIN) * np.min(size / spans))
        x, y = ((lows + highs) / 2 - size / (2 * factor)).tolist()
        return Scale(box, (x, y), (factor, factor))

    def at(self, x: float, y: float) -> Point:
        """Return the place of a point in the picture.

        Args:
            x: First coordinate, in units of reward.
            y: Second coordinate, in units of reward.

        Returns:
            Distances from the left and from the top, in units of the picture.
        """
        return (
            round(self.box.left + (x - self.low[0]) * self.factor[0], 2),
            round(self.box.bottom - (y - self.low[1]) * self.factor[1], 2),
        )

    def ticks(self, axis: int, about: int) -> list[Tick]:
        """Return round numbers along an axis with their places.

        Args:
            axis: 0 for x, 1 for y.
            about: Approximate number of ticks.
        """
        box = self.box
        length = box.right - box.left if axis == 0 else box.bottom - box.top
        low = self.low[axis]
        high = self.low[axis] + length / self.factor[axis]
        steps = round_steps(low, high, about)
        return [Tick(self.at(number, number)[axis], text) for number, text in steps]


def round_steps(low: float, high: float, about: int = 7) -> list[tuple[float, str]]:
    """Return some round numbers between two, with their texts.

    Args:
        low: Lower end.
        high: Upper end, above the lower one.
        about: Largest number of steps between the ends, approximately.
    """
    least = (high - low) / about
    power = 10.0 ** math.floor(math.log10(least))
    # The smallest of 1, 2, 5 times a power of ten that is not below the distance asked for.
    enough = least * (1 - 1e-9)
    step = power * next(step for step in (1.0, 2.0, 5.0, 10.0) if step * power >= enough)
    numbers = [step * row for row in range(math.ceil(low / step), math.floor(high / step) + 1)]
    return [(number, f"{number + 0.0:g}".replace("-", "−")) for number in numbers]


def path(points: Sequence[Point], closed: bool = False) -> str:
    """Return straight lines through places as an SVG path.

    Args:
        points: Places (x, y), at least one.
        closed: Whether a line leads back to the first place.
    """
    text = "M" + " L".join(f"{x:g} {y:g}" for x, y in points)
    return text + " Z" if closed else text


BOX = Box(44, 10, 352, 258)
_ROUND = 72  # points of an ellipse
_APART = 10.0  # units of the picture between marks whose numbers can be read


@dataclass(frozen=True)
class Mark:
    """A reference by its number in the table; if another covers it, its number can't be read."""

    number: int
    x: float
    y: float
    hidden: bool


@dataclass(frozen=True)
class Panel:
    """One picture, in units of its view box."""

    box: Box
    x_ticks: list[Tick]
    y_ticks: list[Tick]
    zero: Point | None  # place of (0, 0), or None if it is outside
    mean: Point  # place of the policy's mean
    best: Point | None = None  # place of the best reference at the declared angle
    marks: tuple[Mark, ...] = ()
    front: str = ""  # path through the best references for angles from 0 to 90 degrees
    ellipse: str = ""  # path of the confidence ellipse of the mean
    arrow: tuple[Point, Point] | None = None  # from and to: the declared direction
    cloud: tuple[Point, ...] = ()  # places of single episodes


def means(report: Json) -> Panel:
    """Return the means of the policy and all references, with the declared direction."""
    region = _ellipse(report["tests"]["identifiability"])
    references = [_of(row) for row in report["references"]]
    mean = _of(report["policy"]["means"])
    angle = report["declaration"]["angle"]
    scale = scale_of(report)
    box = scale.box
    reach = 0.42 * max(math.hypot(*point) for point in [*references, mean])
    tip = reach * math.cos(math.radians(angle)), reach * math.sin(math.radians(angle))
    for _ in range(200):  # until it is inside the axes
        x, y = scale.at(*tip)
        if box.left + 4 <= x <= box.right - 4 and box.top + 4 <= y <= box.bottom - 4:
            break
        tip = (0.97 * tip[0], 0.97 * tip[1])
    marks: list[Mark] = []
    best = None
    for number, (row, point) in enumerate(zip(report["references"], references, strict=True), 1):
        x, y = scale.at(*point)
        visible = (mark for mark in marks if not mark.hidden)
        hidden = any(math.dist((x, y), (mark.x, mark.y)) < _APART for mark in visible)
        marks.append(Mark(number, x, y, hidden))
        if row["name"] == report["tests"]["regret"]["best"]:
            best = (x, y)
    return _panel(
        scale,
        mean,
        best=best,
        marks=tuple(marks),
        front=path([scale.at(*point) for point in front(references)]),
        ellipse=path([scale.at(*point) for point in region], closed=True),
        arrow=(scale.at(0.0, 0.0), scale.at(*tip)),
    )


def episodes(report: Json) -> Panel:
    """Return single episodes of the policy around their mean."""
    scale = scale_of(report)
    cloud = tuple(scale.at(*point) for point in _cloud(report))
    return _panel(scale, _of(report["policy"]["means"]), cloud=cloud)


def scale_of(report: Json) -> Scale:
    """Return the scale of both pictures: all of either is inside."""
    region = _ellipse(report["tests"]["identifiability"])
    means = [_of(row) for row in (report["policy"]["means"], *report["references"])]
    return Scale.over([*means, *region, *_cloud(report), (0.0, 0.0)], BOX)


def _cloud(report: Json) -> list[Point]:
    return [(float(env), float(social)) for env, social in report["cloud"]]


def front(points: Sequence[Point]) -> list[Point]:
    """Return the points that are best at angles from 0 to 90 degrees, in the order of angles."""
    best: list[Point] = []
    for degrees in range(91):
        env = math.cos(math.radians(degrees))
        social = math.sin(math.radians(degrees))
        # Where one weight is 0, ties are broken by the other reward.
        leader = max(points, key=lambda row: env * row[0] + social * row[1] + 1e-9 * sum(row))
        if leader not in best:
            best.append(leader)
    return best


def _panel(scale: Scale, mean: Point, **parts: Any) -> Panel:
    x, y = zero = scale.at(0.0, 0.0)
    box = scale.box
    inside = box.left <= x <= box.right and box.top <= y <= box.bottom
    return Panel(
        box=box,
        x_ticks=scale.ticks(0, 7),
        y_ticks=scale.ticks(1, 7),
        zero=zero if inside else None,
        mean=scale.at(*mean),
        **parts,
    )


def _ellipse(region: Json) -> list[Point]:
    tilt = math.radians(region["tilt"])
    points = []
    for step in range(_ROUND):
        turn = 2 * math.pi * step / _ROUND
        along = region["major"] * math.cos(turn)
        across = region["minor"] * math.sin(turn)
        env = region["env"] + along * math.cos(tilt) - across * math.sin(tilt)
        points.append((env, region["social"] + along * math.sin(tilt) + across * math.cos(tilt)))
    return points


def _of(row: Json) -> Point:
    return float(row["r_env"]), float(row["r_social"])


_TICKS = (-135.0, -90.0, -45.0, 0.0, 45.0, 90.0, 135.0)  # degrees
_ROOM = 1.15  # of the largest value that has to be seen


@dataclass(frozen=True)
class AnglePicture:
    """Regret by angle, in units of the view box."""

    box: Box
    x_ticks: list[Tick]
    ends: Point  # where own progress alone counts, and where others alone do
    y_ticks: list[Tick]
    allowed: float  # height of the margin: from the axis' end to it regrets are allowed
    curve: str  # path of the regret at every angle
    within: tuple[str, ...]  # parts of it within the margin
    declared: Point  # place of the regret at the declared angle
    bounds: Point  # heights of its bounds
    least: Point | None  # place of the smallest regret, if it is beyond the margin, else None


def angles(report: Json) -> AnglePicture:
    """Return the picture of a report."""
    test = report["tests"]["regret"]
    rationalised = report["tests"]["rationalised"]
    margin = float(test["margin"])
    declared = -wrapped(-float(report["declaration"]["angle"]), 180.0)
    curve = [(angle, regret_at(report, angle)) for angle in map(float, range(-180, 181))]
    lowest = min(0.0, test["low"], *(regret for _, regret in curve))
    highest = _ROOM * max(1.3 * margin, test["high"], test["regret"], rationalised["least"])
    bottom = lowest - 0.04 * (highest - lowest)

    factors = (BOX.right - BOX.left) / 360.0, (BOX.bottom - BOX.top) / (highest - bottom)
    scale = Scale(BOX, (-180.0, bottom), factors)

    def at(angle: float, regret: float) -> Point:
        return scale.at(angle, min(regret, 2.0 * highest))

    runs: list[list[Point]] = [[]]
    for point in curve:
        if point[1] <= margin:
            runs[-1].append(point)
        elif runs[-1]:
            runs.append([])
    least = None
    if rationalised["least"] > margin:
        least = at(-wrapped(-float(rationalised["least_angle"]), 180.0), rationalised["least"])
    labels = {angle: f"{angle:g}°".replace("-", "−") for angle in _TICKS}
    return AnglePicture(
        box=BOX,
        x_ticks=[Tick(at(angle, 0.0)[0], label) for angle, label in labels.items()],
        ends=(at(0.0, 0.0)[0], at(90.0, 0.0)[0]),
        y_ticks=scale.ticks(1, 7),
        allowed=at(0.0, margin)[1],
        curve=path([at(*point) for point in curve]),
        within=tuple(path([at(*point) for point in run]) for run in runs if len(run) > 1),
        declared=at(declared, test["regret"]),
        bounds=(at(0.0, test["low"])[1], at(0.0, test["high"])[1]),
        least=least,
    )


def regret_at(report: Json, angle: float) -> float:
    """Return the regret at an angle in degrees, towards the best reference by the mean rewards.

    Args:
        report: Content of `report.json`.
        angle: Angle in degrees.
    """
    env = math.cos(math.radians(angle))
    social = math.sin(math.radians(angle))
    rows = [report["policy"]["means"], *report["references"]]
    policy, *references = (env * row["r_env"] + social * row["r_social"] for row in rows)
    return float(max(references) - policy)
