"""Layout of the picture of angles: regret at every angle, against the declared margin."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from socialiq.audit.report.pictures import BOX, Box, Point, Tick, path, round_steps

_TICKS = (-135.0, -90.0, -45.0, 0.0, 45.0, 90.0, 135.0)  # degrees

_ROOM = 1.15  # of the largest value that has to be seen


@dataclass(frozen=True)
class AnglePicture:
    """One picture, in units of its view box.

    Attributes:
        box: Position of the axes.
        x_ticks: Angles.
        ends: Where own progress alone counts, and where others alone do.
        y_ticks: Regrets.
        allowed: Height of the margin: from the axis' end to it regrets are allowed.
        curve: Path of the regret at every angle.
        within: Parts of it within the margin.
        declared: Place of the regret at the declared angle.
        bounds: Heights of its bounds.
        least: Place of the smallest regret, if it is beyond the margin, else None.
    """

    box: Box
    x_ticks: list[Tick]
    ends: tuple[float, float]
    y_ticks: list[Tick]
    allowed: float
    curve: str
    within: tuple[str, ...]
    declared: Point
    bounds: tuple[float, float]
    least: Point | None


def angles(report: Mapping[str, Any]) -> AnglePicture:
    """Return the picture of a report."""
    test, found = report["tests"]["regret"], report["tests"]["rationalised"]
    margin, declared = float(test["margin"]), _turned(float(report["declaration"]["angle"]))
    curve = [(angle, regret_at(report, angle)) for angle in map(float, range(-180, 181))]
    lowest = min(0.0, test["low"], *(regret for _, regret in curve))
    highest = _ROOM * max(1.3 * margin, test["high"], test["regret"], found["least"])
    bottom = lowest - 0.04 * (highest - lowest)

    def at(angle: float, regret: float) -> Point:
        x = BOX.left + (angle + 180.0) / 360.0 * (BOX.right - BOX.left)
        return round(x, 2), round(height(regret), 2)

    def height(regret: float) -> float:
        share = (min(regret, 2.0 * highest) - bottom) / (highest - bottom)
        return BOX.bottom - share * (BOX.bottom - BOX.top)

    beyond = found["least"] > margin
    return AnglePicture(
        box=BOX,
        x_ticks=[Tick(at(one, 0.0)[0], _degrees(one)) for one in _TICKS],
        ends=(at(0.0, 0.0)[0], at(90.0, 0.0)[0]),
        y_ticks=[Tick(round(height(one), 2), text) for one, text in round_steps(bottom, highest)],
        allowed=round(height(margin), 2),
        curve=path([at(*one) for one in curve]),
        within=tuple(path([at(*one) for one in part]) for part in _runs(curve, margin)),
        declared=at(declared, test["regret"]),
        bounds=(round(height(test["low"]), 2), round(height(test["high"]), 2)),
        least=at(_turned(float(found["least_angle"])), found["least"]) if beyond else None,
    )


def regret_at(report: Mapping[str, Any], angle: float) -> float:
    """Return the regret at an angle in degrees, towards the best reference by the mean rewards."""
    env, social = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    rows = [report["policy"]["means"], *report["references"]]
    own, *others = (env * row["r_env"] + social * row["r_social"] for row in rows)
    return float(max(others) - own)


def _runs(curve: Sequence[Point], margin: float) -> list[list[Point]]:
    """Return the parts of a curve that are within the margin, with at least two points each."""
    found: list[list[Point]] = [[]]
    for one in curve:
        if one[1] <= margin:
            found[-1].append(one)
        elif found[-1]:
            found.append([])
    return [part for part in found if len(part) > 1]


def _turned(angle: float) -> float:
    """Return an angle in (-180, 180]."""
    return -((180.0 - angle) % 360.0 - 180.0)


def _degrees(angle: float) -> str:
    return f"{angle:g}°".replace("-", "−")
