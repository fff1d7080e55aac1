"""Counterfactual driving of a vehicle without another: the same model, its own leader kept.

The vehicle drives by the IDM along its own way, behind the vehicles that are recorded there. Where
its way meets the ego's and the ego comes first, it also stops before the area for as long as it
would arrive before the ego has left. The ego is as recorded, holds its speed, or is absent;
everything else is equal. Signals are not in the recordings, so that they are equal too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from socialiq_recordings.conflicts import idm
from socialiq_recordings.conflicts.around import OnWay, in_the_way, leader, on_way
from socialiq_recordings.conflicts.occupancy import Occupancy, expected
from socialiq_recordings.conflicts.pairs import Encounters
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.road.paths import wrapped

Ego = Literal["recorded", "holds", "absent"]


class Rollout(NamedTuple):
    """Result of a model run.

    Attributes:
        speed: At the end, m/s.
        driven: Distance, m.
    """

    speed: float
    driven: float


def rollout(
    encounters: Encounters, ego: int, other: int, frames: tuple[int, int], mode: Ego
) -> Rollout:
    """Run the other vehicle from one frame to another.

    Args:
        encounters: Of the recording.
        ego: Track of the ego.
        other: Track of the vehicle that is run, from its recorded state.
        frames: First and last frame; both vehicles are present at the first.
        mode: The ego as recorded, at the speed of the first frame, or absent.
    """
    first, last = frames
    own, theirs = encounters.ways[ego], encounters.ways[other]
    driver = replace(
        encounters.config.driver,
        desired_speed=max(encounters.config.driver.desired_speed, float(theirs.speed.max())),
    )
    along, speed = theirs.state(first)
    start, area = along, encounters.area(other, ego)
    ego_times = None if area is None else _ego_times(encounters, own, theirs, mode, first)
    for frame in range(first, last):
        gap, leads = _leader(encounters, own, theirs, along, frame, first, mode)
        rate = idm.acceleration(driver, speed, gap, leads)
        if area is not None and ego_times is not None:
            to_area = area.entry[0] - theirs.length / 2 - along
            if to_area > 0 and _gives_way(ego_times, to_area, speed, frame * own.dt):
                rate = min(rate, idm.acceleration(driver, speed, to_area, 0.0))
        made, speed = idm.ballistic(speed, rate, own.dt)
        along += made
    return Rollout(speed, along - start)


def _ego_times(
    encounters: Encounters, own: Way, theirs: Way, mode: Ego, first: int
) -> Occupancy | None:
    """Return the ego's times in the conflict area if it comes first; None otherwise."""
    area = encounters.area(own.track, theirs.track)
    if area is None or mode == "absent":
        return None
    times = expected(own, area.entry[0], area.exit[0])
    if mode == "holds":
        times = _held(own, area.entry[0], area.exit[0], first)
    other = expected(theirs, area.entry[1], area.exit[1])
    return times if times.enters <= other.enters else None


def _held(way: Way, entry: float, end: float, frame: int) -> Occupancy:
    """Return the times in an area at the speed of a frame, also where they were recorded."""
    along, speed = way.state(frame)
    now, half = frame * way.dt, way.length / 2
    ahead = np.array([entry - half - along, end + half - along])
    with np.errstate(divide="ignore"):
        times = now + np.where(ahead <= 0, 0.0, ahead / max(speed, 0.0) if speed > 0 else np.inf)
    return Occupancy(float(times[0]), float(times[1]))


def _gives_way(ego: Occupancy, gap: float, speed: float, now: float) -> bool:
    """Whether a vehicle would arrive at its present speed before the ego has left."""
    return ego.leaves > now and (speed > 0 and now + gap / speed < ego.leaves)


def _leader(
    encounters: Encounters,
    own: Way,
    theirs: Way,
    along: float,
    frame: int,
    first: int,
    mode: Ego,
) -> tuple[float, float]:
    slack = encounters.config.slack
    others = on_way(encounters.scene, theirs, frame, slack)
    if mode != "recorded":
        others = others.without(own.track)
    if mode == "holds":
        held = _ego_on_way(own, theirs, frame, first, slack)
        others = OnWay(*(np.append(a, b) for a, b in zip(others, held, strict=True)))
    found = leader(theirs, along, others)
    return found.gap, found.speed


def _ego_on_way(own: Way, theirs: Way, frame: int, first: int, slack: float) -> OnWay:
    """Return the ego at its held speed, if it is on the other's way at a frame."""
    start, speed = own.state(first)
    point, heading = own.line.points_at(np.array([start + speed * (frame - first) * own.dt]))
    seen = theirs.line.coordinates(point[:, 0], point[:, 1])
    turned = wrapped(heading - seen.heading)
    inside = in_the_way(theirs, seen.lateral, turned, np.array([own.width]), slack)
    every = (np.array([own.track]), seen.along, speed * np.cos(turned), np.array([own.length]))
    return OnWay(*(column[inside] for column in every))
