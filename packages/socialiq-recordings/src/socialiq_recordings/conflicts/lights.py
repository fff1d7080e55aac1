"""Vehicles that a red light holds: what they do is the light's doing, not another vehicle's."""

from __future__ import annotations

from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.road.routes import Scene

NEAR = 50.0
"""m before a light from which a driver brakes for it: from 14 m/s at 2 m/s²."""


def held(scene: Scene, way: Way, frame: int) -> bool:
    """Whether the next light on a vehicle's route is near, ahead of its front, and closed.

    A light is at the end of its lanelet. Lights without states in the file hold no driver.

    Args:
        scene: The recording.
        way: The vehicle's way.
        frame: A frame at which it is present.
    """
    matched, lanelets = scene.matched(way.track), scene.lanes.road.lanelets
    front = way.state(frame)[0] + way.length / 2
    for number in matched.lanelets[int(matched.place[frame - way.first]) :]:
        lanelet = lanelets[number]
        if lanelet.cycle is None:
            continue
        end = lanelet.centre[-1:]
        ahead = float(way.line.coordinates(end[:, 0], end[:, 1]).along[0]) - front
        if ahead >= 0.0:
            return ahead <= NEAR and lanelet.cycle.closed(frame)
    return False
