"""Pictures of conflicts: both ways on the map, and both distances to the area over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from socialiq.plotting.style import COLORS, figure, finish
from socialiq.types import Row
from socialiq_recordings.conflicts.encounters import Encounters, Meeting
from socialiq_recordings.conflicts.ways import BEHIND, Way

_REACH = 35.0  # m around the place where the ego enters the area
_INKS = (COLORS["prosocial"], COLORS["egoistic"])


def drawn_at_random(meetings: Sequence[Meeting], count: int, seed: int) -> list[Meeting]:
    """Return conflicts drawn at random without replacement, each pair of vehicles once.

    Args:
        meetings: All conflicts of some recordings, in order.
        count: How many; all if there are fewer.
        seed: Of the draw.
    """
    pairs = [meeting for meeting in meetings if meeting.ego.track < meeting.other.track]
    chosen = np.random.default_rng(seed).permutation(len(pairs))[:count]
    return [pairs[index] for index in sorted(chosen.tolist())]


def picture(encounters: Encounters, meeting: Meeting, row: Row) -> Figure:
    """Draw a conflict.

    Args:
        encounters: Of its recording.
        meeting: The conflict.
        row: Its row of the table.
    """
    drawing = figure(9.0, 4.3)
    drawing.set_dpi(85)
    left, right = drawing.subplots(1, 2, width_ratios=(1.15, 1.0))
    _map(left, encounters, meeting)
    _distances(right, meeting)
    drawing.suptitle(_title(row), fontsize=9)
    return drawing


def _title(row: Row) -> str:
    order = {None: "neither arrives", True: "A first", False: "B first"}[row["ego_first"]]
    texts = [f"{row['recording']}: A {row['ego']}, B {row['other']}", row["kind"], order]
    for name, unit in (("pet", "s"), ("ttc", "s")):
        value = row[name]
        texts.append(f"{name.upper()} " + ("unknown" if value is None else f"{value:.1f} {unit}"))
    for letter, name in (("A", "required_deceleration"), ("B", "other_required_deceleration")):
        value = row[name]
        texts.append(f"{letter} needs " + ("unknown" if value is None else f"{value:.1f} m/s²"))
    return ", ".join(texts)


def _map(axes: Any, encounters: Encounters, meeting: Meeting) -> None:
    area, scene = meeting.area, encounters.scene
    for lanelet in scene.lanes.road.lanelets.values():
        for bound in (lanelet.left, lanelet.right):
            axes.plot(*bound.T, color="#bbbbbb", linewidth=0.6)
    axes.add_patch(Polygon(area.outline, color="#f0c000", alpha=0.5, zorder=2))
    frame = _shown(meeting)
    _bystanders(axes, encounters, meeting, frame)
    for letter, way, ink in zip("AB", (meeting.ego, meeting.other), _INKS, strict=True):
        driven = way.line.starts.searchsorted(way.along[-1], side="right")
        axes.plot(*way.line.points[1:driven].T, color=ink, linewidth=1.6, zorder=3)
        axes.plot(*way.line.points[driven - 1 :].T, color=ink, linewidth=1.0, linestyle=":")
        _box(axes, way, frame, ink, letter)
    finish(axes, f"at {frame * meeting.ego.dt:.1f} s; others in grey")
    axes.set_aspect("equal")
    entry = meeting.ego.line.points_at(np.array(area.entry[:1]))[0][0]
    axes.set_xlim(entry[0] - _REACH, entry[0] + _REACH)
    axes.set_ylim(entry[1] - _REACH, entry[1] + _REACH)


def _shown(meeting: Meeting) -> int:
    """Return the last frame at which both are present before the first enters the area."""
    enters = min(meeting.ego_times.enters, meeting.other_times.enters)
    low = max(meeting.ego.first, meeting.other.first)
    high = min(meeting.ego.last, meeting.other.last)
    moment = high if np.isinf(enters) else int(enters / meeting.ego.dt)
    return int(np.clip(moment, low, high))


def _bystanders(axes: Any, encounters: Encounters, meeting: Meeting, frame: int) -> None:
    tracks = encounters.scene.tracks
    for row in encounters.scene.present(frame).tolist():
        track = int(tracks.track[row])
        if track not in (meeting.ego.track, meeting.other.track):
            size = float(tracks.length[track]), float(tracks.width[track])
            centre = float(tracks.x[row]), float(tracks.y[row])
            corners = _corners(centre, float(tracks.heading[row]), size)
            axes.add_patch(Polygon(corners, color="#999999", alpha=0.5))


def _box(axes: Any, way: Way, frame: int, ink: str, letter: str) -> None:
    along, _ = way.state(frame)
    point, heading = way.line.points_at(np.array([max(along, BEHIND)]))
    centre = float(point[0, 0]), float(point[0, 1])
    corners = _corners(centre, float(heading[0]), (way.length, way.width))
    axes.add_patch(Polygon(corners, color=ink, alpha=0.8, zorder=4))
    axes.annotate(letter, centre, ha="center", va="center", color="white", fontsize=8, zorder=5)


def _corners(
    place: tuple[float, float], heading: float, size: tuple[float, float]
) -> Float64[np.ndarray, "4 2"]:
    ahead = np.array([np.cos(heading), np.sin(heading)]) * size[0] / 2
    left = np.array([-np.sin(heading), np.cos(heading)]) * size[1] / 2
    return np.array(place) + np.array([ahead + left, ahead - left, -ahead - left, left - ahead])


def _distances(axes: Any, meeting: Meeting) -> None:
    """Draw the distance of each front to the area; a bar shows when a vehicle is in it."""
    sides = zip(
        "AB",
        (meeting.ego, meeting.other),
        (meeting.ego_times, meeting.other_times),
        meeting.area.entry,
        strict=True,
    )
    for row, (letter, way, times, entry) in enumerate(sides):
        time = (way.first + np.arange(len(way.along))) * way.dt
        front = entry - way.length / 2 - way.along
        axes.plot(time, front, color=_INKS[row], label=f"{letter}, recorded")
        if np.isfinite(times.enters):
            end = times.leaves if np.isfinite(times.leaves) else times.enters
            axes.plot(
                [times.enters, max(end, times.enters + 0.1)],
                [-1.5 - 1.5 * row] * 2,
                color=_INKS[row],
                linewidth=5,
                solid_capstyle="butt",
                label=f"{letter} in the area",
            )
    axes.axhline(0.0, color="#888888", linewidth=0.8)
    axes.set_ylim(-15.0, 60.0)
    finish(axes, "", 7, xlabel="s from the start", ylabel="m from the front to the area")
