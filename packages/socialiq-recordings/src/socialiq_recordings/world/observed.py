"""Speeds, headways, gaps and conflicts that recordings show, recorded or simulated alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from socialiq_recordings.conflicts.around import leader, on_way
from socialiq_recordings.conflicts.pairs import Encounters
from socialiq_recordings.conflicts.table import gaps, pet
from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.world.lines import curvature, line_of

_MOVING = 2.0  # m/s
_STANDING = 0.5  # m/s
_FREE = 4.0  # s; a leader further ahead does not bind
_STEADY = 1.5  # m/s; largest difference of speeds in steady following
_CURVED = 1 / 80  # 1/m; sharper ways are curves
_AHEAD = 60.0  # m; further leaders are not followed
_SECOND = 1.0  # s between the moments


class Followed(NamedTuple):
    """Moments at which a vehicle follows another.

    Attributes:
        speed: m/s.
        gap: Between bumpers, m.
        leader_speed: m/s.
        acceleration: Of the next second, m/s².
    """

    speed: Float64[np.ndarray, " moment"]
    gap: Float64[np.ndarray, " moment"]
    leader_speed: Float64[np.ndarray, " moment"]
    acceleration: Float64[np.ndarray, " moment"]


class Observed(NamedTuple):
    """Quantities of the traffic of some recordings.

    Attributes:
        speeds: Of all vehicles at all moments, m/s.
        free_speeds: Fastest of each vehicle without leader or curve, m/s.
        headways: Median gap by speed of each vehicle that follows steadily, s.
        standing_gaps: Median gap of each vehicle that stands behind another, m.
        lateral: v² κ in curves, m/s².
        followed: Moments of following.
        pets: Post-encroachment times of conflicts, s.
        accepted: Gaps and lags accepted, s.
        vehicles: Number of vehicles.
    """

    speeds: Float64[np.ndarray, " moment"]
    free_speeds: Float64[np.ndarray, " vehicle"]
    headways: Float64[np.ndarray, " vehicle"]
    standing_gaps: Float64[np.ndarray, " vehicle"]
    lateral: Float64[np.ndarray, " moment"]
    followed: Followed
    pets: Float64[np.ndarray, " conflict"]
    accepted: Float64[np.ndarray, " conflict"]
    vehicles: int


def observe(every: Sequence[Encounters], kept: Sequence[set[int]]) -> Observed:
    """Return what some recordings show.

    Args:
        every: Encounters of each recording.
        kept: Tracks of each that count, so that a vehicle in two recordings counts once.
    """
    rows: dict[str, list[float]] = {
        name: []
        for name in (*Observed._fields, *Followed._fields)
        if name not in ("followed", "vehicles")
    }
    vehicles = 0
    for encounters, tracks in zip(every, kept, strict=True):
        for way in encounters.ways.values():
            if way.track in tracks:
                _vehicle(encounters, way, rows)
                vehicles += 1
        _conflicts(encounters, tracks, rows)
    arrays = {name: np.array(values, np.float64) for name, values in rows.items()}
    followed = Followed(*(arrays.pop(name) for name in Followed._fields))
    return Observed(**arrays, followed=followed, vehicles=vehicles)


def _vehicle(encounters: Encounters, way: Way, rows: dict[str, list[float]]) -> None:
    """Add the moments of a vehicle, one a second."""
    second = max(1, round(_SECOND / way.dt))
    bends = curvature(line_of(way))
    free, headways, standing = [], [], []
    for frame in range(way.first, way.last + 1, second):
        along, speed = way.state(frame)
        rows["speeds"].append(speed)
        bend = float(bends[min(int(along), len(bends) - 1)])
        ahead = leader(way, along, on_way(encounters.scene, way, frame, encounters.config.slack))
        if bend > _CURVED and speed > _MOVING:
            rows["lateral"].append(speed**2 * bend)
        elif ahead.gap > _FREE * speed and speed > _MOVING:
            free.append(speed)
        if not 0 < ahead.gap < _AHEAD:
            continue
        if speed > _MOVING and abs(speed - ahead.speed) < _STEADY and ahead.gap < _FREE * speed:
            headways.append(ahead.gap / speed)
        if speed < _STANDING and ahead.speed < _STANDING and ahead.gap < 10.0:
            standing.append(ahead.gap)
        if frame + second <= way.last and max(speed, ahead.speed) > _STANDING:
            rows["speed"].append(speed)
            rows["gap"].append(ahead.gap)
            rows["leader_speed"].append(ahead.speed)
            rows["acceleration"].append((way.state(frame + second)[1] - speed) / _SECOND)
    for name, values, best in (
        ("free_speeds", free, np.max),
        ("headways", headways, np.median),
        ("standing_gaps", standing, np.median),
    ):
        if values:
            rows[name].append(float(best(values)))


def _conflicts(encounters: Encounters, tracks: set[int], rows: dict[str, list[float]]) -> None:
    for meeting in encounters.meetings():
        if meeting.ego.track not in tracks and meeting.other.track not in tracks:
            continue
        if meeting.ego.track < meeting.other.track and np.isfinite(pet(meeting)):
            rows["pets"].append(pet(meeting))
        if meeting.ego_first:
            gap, lag = gaps(encounters, meeting)
            rows["accepted"] += [one for one in (gap, lag) if np.isfinite(one)]
