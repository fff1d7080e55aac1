"""Layout of the moving pictures of a report: vehicles on their ways, as keyframes of CSS.

CSS rather than a film: no script runs, a reader who wants no motion gets still pictures, and print
shows the last frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from socialiq.audit.evidence.replay import Pose
from socialiq.audit.report.pictures import path
from socialiq.types import Json
from socialiq.worlds.catalogue import GRIDS, INTERSECTION, base, scene_named
from socialiq.worlds.grammar import build
from socialiq.worlds.highway import shapes
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH
from socialiq.worlds.highway.network import APPROACH, EXIT, LANE_WIDTH
from socialiq.worlds.intersection.views import JUNCTION
from socialiq.worlds.registry import make_grid

HELD = 1.5  # seconds for which the last frame is held before the picture begins again
_BESIDE = 8.0  # m around what is shown of a scene
_WIDEST = 110.0  # m
_FOLLOWED = 64.0  # m of the view along an axis on which it follows the ego
_AWAY = "translate(-9999px,0px)"


class Ground(NamedTuple):
    """Path of a world's road, and the size of its vehicles, in the picture's units."""

    view: tuple[float, float, float, float]  # left, top, width and height of the view
    road: str
    length: float
    width: float
    tolerance: float  # largest error of a place between keyframes
    follows: tuple[bool, bool] = (False, False)  # whether the view follows the ego, by axis


class Keyframe(NamedTuple):
    """Transform at a time, in percent of the animation."""

    percent: float
    transform: str


@dataclass(frozen=True)
class Car:
    """A vehicle by the name of its animation; `still` is its transform in the last frame, or ""."""

    name: str
    ego: bool
    still: str
    keyframes: tuple[Keyframe, ...]


@dataclass(frozen=True)
class MovingPicture:
    """An episode."""

    kind: str  # "worst" or "median"
    number: int  # number of the episode of this kind, from 1
    row: Json  # its row in the report
    seconds: float  # duration of a round, with `HELD`; 0 without a trace
    ground: Ground  # road and sizes
    way: str  # path of the ego
    cars: tuple[Car, ...]  # vehicles, the ego last, so that it is drawn on top
    camera: tuple[Keyframe, ...] = ()  # of the picture, where the view follows the ego
    framed: str = ""  # the last of them
    crashes: tuple[tuple[float, float], ...] = ()  # places of those that have collided at the end
    ended: float = 0.0  # when the episode has ended, in percent of a round


def moving(report: Json) -> list[MovingPicture]:
    """Return the moving pictures of a report, none in an environment of other code."""
    scenario = report["declaration"]["scenario"]
    ground = ground_of(scenario["world"], scenario.get("options", {}))
    if ground is None:
        return []
    return [
        _picture(kind, number, row, ground)
        for kind in ("worst", "median")
        for number, row in enumerate(report["episodes"][kind], 1)
    ]


def ground_of(world: str, options: Json) -> Ground | None:
    """Return the ground of a world, None for an environment of other code.

    Args:
        world: Name of the world.
        options: Its options, from which a generated road follows.
    """
    if base(world) in GRIDS:
        size = make_grid(world).size
        middle = (size - 1) / 2
        end = size - 0.5
        low = middle - 0.5
        high = middle + 0.5
        road = f"M-.5 {low:g} H{end:g} V{high:g} H-.5 Z M{low:g} -.5 H{high:g} V{end:g} H{low:g} Z"
        return Ground((-0.5, -0.5, size, size), road, 0.74, 0.44, 0.02)
    if base(world) == INTERSECTION:
        side = LANE_WIDTH
        far = 60.0
        stop = JUNCTION
        bend = f"A{stop - side:g} {stop - side:g} 0 0"
        road = (  # two roads with round corners, clockwise from the northern arm
            f"M{side:g} {-far:g} V{-stop:g} {bend} 0 {stop:g} {-side:g} H{far:g} V{side:g} "
            f"H{stop:g} {bend} 0 {side:g} {stop:g} V{far:g} H{-side:g} V{stop:g} "
            f"{bend} 0 {-stop:g} {side:g} H{-far:g} V{-side:g} H{-stop:g} "
            f"{bend} 0 {-side:g} {-stop:g} V{-far:g} Z"
        )
        return Ground((-32.0, -28.0, 64.0, 64.0), road, VEHICLE_LENGTH, VEHICLE_WIDTH, 0.2)
    scene = scene_named(world)
    if scene is None:
        return None
    # In view: where ways meet and the ego's entry, or what is around the ego.
    world_of_road: Any = build(scene, options)
    highway = world_of_road.scene.road
    lines = [
        shapes.way(highway.lanes[entry["lane"]], float(entry["along"]))[:1]
        for entry in highway.entries[:1]  # none of a road on which vehicles arrive at random
    ]
    lines += [shapes.way(lane) for lane in highway.lanes if APPROACH < lane["kind"] < EXIT]
    points = np.concatenate(lines)
    first = points.min(axis=0) - _BESIDE
    last = points.max(axis=0) + _BESIDE
    follows = last - first > _WIDEST
    first = np.where(follows, -_FOLLOWED / 2, first)
    last = np.where(follows, _FOLLOWED / 2, last)
    left, top, wide, deep = np.round([*first, *(last - first)], 1).tolist()
    outlines = []
    for lane in highway.lanes:
        line = shapes.way(lane)
        straight = lane["straight"] and not lane["amplitude"]  # else a point every 2 m
        points = line[[0, -1]] if straight else line[[*range(0, len(line) - 1, 4), -1]]
        edge, right = shapes.edges(points, LANE_WIDTH)
        strip = np.concatenate([right, edge[::-1]]).round(1).tolist()
        outlines.append(path([(x, y) for x, y in strip], closed=True))
    view = left, top, wide, deep
    along = bool(follows[0]), bool(follows[1])
    return Ground(view, " ".join(outlines), VEHICLE_LENGTH, VEHICLE_WIDTH, 0.2, along)


def _picture(kind: str, number: int, row: Json, ground: Ground) -> MovingPicture:
    trace = row["trace"]
    if trace is None:
        return MovingPicture(kind, number, row, 0.0, ground, "", ())
    duration = (trace["frames"] - 1) / trace["per_second"]
    seconds = duration + HELD
    # In percent of a round per frame.
    pace = 100.0 / (seconds * trace["per_second"])
    ways = [(track, poses(track["poses"])) for track in trace["tracks"]]
    cars = [
        Car(
            f"{kind}-{number}-{car}",
            track["ego"],
            _still(way[-1]) if track["first"] + len(way) >= trace["frames"] else "",
            _keyframes(way, track["first"], trace["frames"], pace, ground.tolerance),
        )
        for car, (track, way) in enumerate(ways)
    ]
    crashed = [way[-1] for track, way in ways if track["crashed"]]
    ego = next((way for track, way in ways if track["ego"]), [])
    camera = []
    if any(ground.follows):  # shifts that bring the ego to the middle of the view
        by_x, by_y = ground.follows
        camera = [Pose(-x if by_x else 0.0, -y if by_y else 0.0, 0.0) for x, y, _ in ego]
    return MovingPicture(
        kind,
        number,
        row,
        round(seconds, 2),
        ground,
        path([(pose.x, pose.y) for pose in ego]) if ego else "",
        tuple(reversed(cars)),
        _keyframes(camera, 0, trace["frames"], pace, ground.tolerance) if camera else (),
        _still(camera[-1]) if camera else "",
        tuple((pose.x, pose.y) for pose in crashed),
        round(pace * (trace["frames"] - 1), 2),
    )


def poses(text: str) -> list[Pose]:
    """Read the poses of a track: see `evidence.replay.Track`."""
    return [Pose(*map(float, numbers.split(" "))) for numbers in text.split(";")]


def _keyframes(
    way: Sequence[Pose], first: int, frames: int, pace: float, tolerance: float
) -> tuple[Keyframe, ...]:
    """Return the keyframes of a way; before and after it the vehicle is away."""
    keyframes = [Keyframe(0.0, _AWAY), Keyframe(pace * first - 0.01, _AWAY)] if first else []
    turning = simplified(way, tolerance)
    keyframes += [Keyframe(pace * (first + frame), _css(way[frame])) for frame in turning]
    last = first + len(way) - 1
    if last < frames - 1:
        keyframes += [Keyframe(pace * last + 0.01, _AWAY), Keyframe(100.0, _AWAY)]
    else:
        keyframes.append(Keyframe(100.0, _css(way[-1])))
    return tuple(Keyframe(round(max(percent, 0.0), 2), text) for percent, text in keyframes)


_TURN = 3.0  # degrees, largest error of a heading between keyframes


def simplified(way: Sequence[Pose], tolerance: float) -> list[int]:
    """Return the frames between which motion is uniform: Douglas and Peucker over the time.

    Args:
        way: Pose of the vehicle in each frame.
        tolerance: Largest error of a place between two of the frames, in the unit of the poses.

    Returns:
        Numbers of frames, rising; the first and the last one are among them.
    """
    frames = {0, len(way) - 1}
    open_parts = [(0, len(way) - 1)]
    while open_parts:
        start, end = open_parts.pop()
        errors = []
        for frame in range(start + 1, end):  # of uniform motion, in tolerances
            share = (frame - start) / (end - start)
            x, y, heading = (
                from_value + share * (to_value - from_value)
                for from_value, to_value in zip(way[start], way[end], strict=True)
            )
            off = math.hypot(way[frame].x - x, way[frame].y - y)
            error = max(off / tolerance, abs(way[frame].heading - heading) / _TURN)
            errors.append((error, frame))
        worst, frame = max(errors, default=(0.0, start))
        if worst > 1.0:
            frames.add(frame)
            open_parts += [(start, frame), (frame, end)]
    return sorted(frames)


def _css(pose: Pose) -> str:
    return f"translate({pose.x:g}px,{pose.y:g}px) rotate({pose.heading:g}deg)"


def _still(pose: Pose) -> str:
    return f"translate({pose.x:g} {pose.y:g}) rotate({pose.heading:g})"
