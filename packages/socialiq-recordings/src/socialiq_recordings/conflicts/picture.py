"""Picture of a conflict of two recorded vehicles."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from socialiq.physics import corners
from socialiq.plotting.style import COLORS, figure, finish
from socialiq.types import Row
from socialiq_recordings.conflicts.encounters import Encounters, Meeting
from socialiq_recordings.conflicts.ways import BEHIND

_REACH = 35.0  # m around the place where the ego enters the area
_MEASURES = (
    ("pet", "PET", "s"),
    ("ttc", "TTC", "s"),
    ("required_deceleration", "A needs", "m/s²"),
    ("other_required_deceleration", "B needs", "m/s²"),
)
_HEAD_ON = (("lateral_clearance", "lateral clearance", "m"),)
_INKS = (COLORS["prosocial"], COLORS["egoistic"])


def picture(encounters: Encounters, meeting: Meeting, row: Row) -> Figure:
    """Draw a conflict: both ways on the map, and both distances to the area over time.

    Args:
        encounters: Encounters of the recording; its map and its other road users are drawn, too.
        meeting: The conflict. The ego is A in the picture, its partner B.
        row: Its row of `measures.rows_of`, whose measures stand in the title.

    Returns:
        The map at the last frame at which both are present before the first enters the area, and to
        its right the distances from the fronts to the area, m, over the time, s.
    """
    drawing = figure(9.0, 4.3)
    drawing.set_dpi(85)
    left, right = drawing.subplots(1, 2, width_ratios=(1.15, 1.0))
    _map(left, encounters, meeting)
    ways = meeting.ego, meeting.other
    both_times = meeting.ego_times, meeting.other_times
    sides = zip("AB", _INKS, ways, both_times, meeting.area.entry, strict=True)
    for below, (letter, ink, way, times, entry) in enumerate(sides):
        time = (way.first + np.arange(len(way.along))) * way.dt
        front = entry - way.length / 2 - way.along
        right.plot(time, front, color=ink, label=f"{letter}, recorded")
        if np.isfinite(times.enters):
            end = times.leaves if np.isfinite(times.leaves) else times.enters
            ends = [times.enters, max(end, times.enters + 0.1)]
            height = -1.5 - 1.5 * below
            bar = {"linewidth": 5, "solid_capstyle": "butt", "label": f"{letter} in the area"}
            right.plot(ends, [height] * 2, color=ink, **bar)
    right.axhline(0.0, color="#888888", linewidth=0.8)
    right.set_ylim(-15.0, 60.0)
    finish(right, "", 7, xlabel="s from the start", ylabel="m from the front to the area")
    order = {None: "neither arrives", True: "A first", False: "B first"}[row["ego_first"]]
    texts = [f"{row['recording']}: A {row['ego']}, B {row['other']}", row["kind"]]
    measures = _HEAD_ON if meeting.is_head_on else _MEASURES
    texts += [] if meeting.is_head_on else [order]
    for name, words, unit in measures:
        value = row[name]
        known = value if isinstance(value, str) else f"{value or 0.0:.1f} {unit}"
        texts.append(f"{words} {'unknown' if value is None else known}")
    drawing.suptitle(", ".join(texts), fontsize=9)
    return drawing


def _map(axes: Any, encounters: Encounters, meeting: Meeting) -> None:
    """Draw the last frame at which both are present before the first enters the area."""
    area = meeting.area
    scene = encounters.scene
    ways = meeting.ego, meeting.other
    for lanelet in scene.lanes.road.lanelets.values():
        for bound in (lanelet.left, lanelet.right):
            axes.plot(*bound.T, color="#bbbbbb", linewidth=0.6)
    axes.add_patch(Polygon(area.outline, color="#f0c000", alpha=0.5, zorder=2))
    enters = min(meeting.ego_times.enters, meeting.other_times.enters)
    low = max(way.first for way in ways)
    high = min(way.last for way in ways)
    moment = high if np.isinf(enters) else int(enters / meeting.ego.dt)
    frame = int(np.clip(moment, low, high))
    tracks = scene.tracks
    rows = scene.present(frame)
    for row in rows[~np.isin(tracks.track[rows], [way.track for way in ways])].tolist():
        track = tracks.track[row]
        size = float(tracks.length[track]), float(tracks.width[track])
        centre = np.array([tracks.x[row], tracks.y[row]])
        outline = corners(centre, float(tracks.heading[row]), *size)
        axes.add_patch(Polygon(outline, color="#999999", alpha=0.5))
    for letter, way, ink in zip("AB", ways, _INKS, strict=True):
        driven = way.line.starts.searchsorted(way.along[-1], side="right")
        axes.plot(*way.line.points[1:driven].T, color=ink, linewidth=1.6, zorder=3)
        axes.plot(*way.line.points[driven - 1 :].T, color=ink, linewidth=1.0, linestyle=":")
        point, heading = way.line.points_at(np.array([max(way.state(frame)[0], BEHIND)]))
        outline = corners(point[0], float(heading[0]), way.length, way.width)
        axes.add_patch(Polygon(outline, color=ink, alpha=0.8, zorder=4))
        style = {"ha": "center", "va": "center", "color": "white", "fontsize": 8, "zorder": 5}
        axes.annotate(letter, point[0], **style)
    finish(axes, f"at {frame * meeting.ego.dt:.1f} s; others in grey")
    axes.set_aspect("equal")
    x, y = meeting.ego.line.points_at(np.array(area.entry[:1]))[0][0]
    axes.set_xlim(x - _REACH, x + _REACH)
    axes.set_ylim(y - _REACH, y + _REACH)
