"""Moments of conflicts: what a driver model may see, and what happened next.

A row is a decision of a conflict's ego. What was known then comes first, and then the targets:
the acceleration of the next second and the positions of the next three. Speeds are those that the
recording states for that frame, because the smoothed ones of other measures look half a second
ahead. Routes are taken as known. `ego_first` is the conflict's outcome, which is known only
later: neither an input nor a target of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from socialiq.types import Row
from socialiq_recordings.conflicts import occupancy
from socialiq_recordings.conflicts.around import follower, leader, on_way
from socialiq_recordings.conflicts.pairs import Encounters, Meeting
from socialiq_recordings.conflicts.table import known, required_at, sign, ttc_at, turn
from socialiq_recordings.conflicts.ways import Way

AHEAD = (1, 2, 3)
"""s after a moment at which the position is a target."""


def moments_of(
    encounters: Encounters, meetings: Sequence[Meeting], seconds: float = 1.0
) -> list[Row]:
    """Return a row for each decision of each conflict; a number that isn't known is None.

    Args:
        encounters: Of the recording.
        meetings: Its conflicts.
        seconds: Between two moments.
    """
    rows = []
    for number, smooth in enumerate(meetings):
        ego, other = stated(encounters, smooth.ego), stated(encounters, smooth.other)
        meeting = replace(smooth, ego=ego, other=other)
        step = max(round(seconds / meeting.ego.dt), 1)
        for frame in meeting.frames[::step].tolist():
            rows.append({"conflict": number} | _moment(encounters, meeting, frame))
    return [{name: known(value) for name, value in row.items()} for row in rows]


def stated(encounters: Encounters, way: Way) -> Way:
    """Return a way with the speeds that the recording states."""
    return replace(way, speed=encounters.scene.speed[encounters.scene.rows(way.track)])


def _moment(encounters: Encounters, meeting: Meeting, frame: int) -> Row:
    scene, ego, other = encounters.scene, meeting.ego, meeting.other
    area, now = meeting.area, frame * meeting.ego.dt
    row: Row = {
        "recording": scene.tracks.recording,
        "ego": int(scene.tracks.identity[ego.track]),
        "other": int(scene.tracks.identity[other.track]),
        "time": now,
        "kind": area.kind.name.lower(),
        "angle": area.angle,
    }
    for place, (name, way) in enumerate((("ego", ego), ("other", other))):
        along, speed = way.state(frame)
        times = occupancy.projected(way, area.entry[place], area.exit[place], frame)
        row |= {
            f"{name}_gap": area.entry[place] - way.length / 2 - along,
            f"{name}_speed": speed,
            f"{name}_acceleration_before": change(way, frame, -1.0),
            f"{name}_arrives": times.enters - now,
            f"{name}_leaves": times.leaves - now,
            f"{name}_turn": turn(way, area.entry[place], area.exit[place]),
            f"{name}_sign": sign(encounters, way, other if name == "ego" else ego),
            f"{name}_length": way.length,
        }
    row |= {"ttc": ttc_at(meeting, frame), "required_deceleration": required_at(meeting, frame)}
    row |= _neighbours(encounters, meeting, frame)
    return row | _targets(encounters, meeting, frame) | {"ego_first": meeting.ego_first}


def _neighbours(encounters: Encounters, meeting: Meeting, frame: int) -> Row:
    along, _ = meeting.ego.state(frame)
    others = on_way(encounters.scene, meeting.ego, frame, encounters.config.slack)
    found = {
        "leader": leader(meeting.ego, along, others),
        "follower": follower(meeting.ego, along, others),
    }
    return {
        f"{name}_{what}": value if one.track >= 0 else math.nan
        for name, one in found.items()
        for what, value in (("gap", one.gap), ("speed", one.speed))
    }


def _targets(encounters: Encounters, meeting: Meeting, frame: int) -> Row:
    ego, tracks = meeting.ego, encounters.scene.tracks
    row: Row = {"acceleration": change(ego, frame, 1.0)}
    along, _ = ego.state(frame)
    for seconds in AHEAD:
        then = frame + round(seconds / ego.dt)
        seen = encounters.scene.row_at(ego.track, then)
        row |= {
            f"driven_{seconds}": math.nan if seen is None else ego.state(then)[0] - along,
            f"x_{seconds}": math.nan if seen is None else float(tracks.x[seen]),
            f"y_{seconds}": math.nan if seen is None else float(tracks.y[seen]),
        }
    return row


def change(way: Way, frame: int, seconds: float) -> float:
    """Return the mean acceleration of a vehicle between a frame and a time before or after it.

    Args:
        way: The vehicle's way.
        frame: The frame.
        seconds: After the frame; negative before it.

    Returns:
        m/s²; NaN if it wasn't in view then.
    """
    then = frame + round(seconds / way.dt)
    if not way.first <= then <= way.last:
        return math.nan
    return float(np.diff([way.state(frame)[1], way.state(then)[1]])[0]) / seconds
