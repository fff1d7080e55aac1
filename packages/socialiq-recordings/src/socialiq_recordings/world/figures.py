"""Pictures of a recorded junction: moments of episodes, simulated beside recorded traffic."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from socialiq.plotting.style import COLORS, figure, finish
from socialiq_recordings.world.batch import JunctionBatch
from socialiq_recordings.world.compare import QUANTITIES
from socialiq_recordings.world.observed import Observed

_REACH = 50.0  # m around the ego
_INKS = {"recorded": COLORS["baseline"], "simulated": COLORS["prosocial"]}


def scene(batch: JunctionBatch, row: int = 0) -> Figure:
    """Draw a moment: all ways, the ego's way, vehicles, closed lines.

    Args:
        batch: The episodes.
        row: Number of the episode.
    """
    road, traffic = batch.world.road, batch.traffic
    recording = int(traffic.recording[row])
    base, end = (int(road.recording_first[recording + one]) for one in range(2))
    drawn = figure(5.0, 5.0)
    axes = drawn.subplots()
    lines = [road.line[road.line_first[v] : road.line_first[v + 1], :2] for v in range(base, end)]
    axes.add_collection(LineCollection(lines, colors="#d5d5d5", linewidths=1.0))
    ego = int(traffic.ego[row])
    axes.plot(*lines[ego].T, color=COLORS["egoistic"], linewidth=1.2)
    now = float(traffic.step[row]) / 10
    for place in range(int(traffic.n_present[row])):
        one = int(traffic.present[row, place])
        ink = COLORS["egoistic"] if one == ego else COLORS["prosocial"]
        x, y, heading = _place(lines[one], float(traffic.along[row, one]))
        size = float(road.length[base + one]), float(road.width[base + one])
        axes.add_patch(Polygon(_corners(x, y, heading, *size), color=ink, zorder=3))
        for at, begin, until in road.closed[
            road.closed_first[base + one] : road.closed_first[base + one + 1]
        ]:
            if begin <= now < until:
                _bar(axes, lines[one], float(at))
    x, y, _ = _place(lines[ego], float(traffic.along[row, ego]))
    axes.set_aspect("equal")
    axes.set(xlim=(x - _REACH, x + _REACH), ylim=(y - _REACH, y + _REACH))
    finish(axes, f"{now:.1f} s", xlabel="m to the east", ylabel="m to the north")
    return drawn


def _place(line: np.ndarray, along: float) -> tuple[float, float, float]:
    piece = min(max(int(along), 0), len(line) - 2)
    step = line[piece + 1] - line[piece]
    x, y = (line[piece] + (along - piece) * step).tolist()
    return x, y, math.atan2(step[1], step[0])


def _corners(x: float, y: float, heading: float, length: float, width: float) -> np.ndarray:
    along = np.array([math.cos(heading), math.sin(heading)]) * length / 2
    left = np.array([-math.sin(heading), math.cos(heading)]) * width / 2
    return np.array([x, y]) + np.array([along + left, along - left, -along - left, left - along])


def _bar(axes: Any, line: np.ndarray, at: float) -> None:
    x, y, heading = _place(line, at)
    dx, dy = -1.6 * math.sin(heading), 1.6 * math.cos(heading)
    axes.plot([x - dx, x + dx], [y - dy, y + dy], color="black", linewidth=2.0, zorder=4)


def beside(recorded: Observed, simulated: Observed) -> Figure:
    """Draw the distribution function of each quantity, recorded and simulated.

    Args:
        recorded: What the recordings show.
        simulated: What simulated traffic shows from the same starts.
    """
    drawn = figure(9.5, 5.6)
    panels = drawn.subplots(2, 3).ravel()
    for axes, (name, label) in zip(panels, QUANTITIES.items(), strict=False):
        for source, observed in (("recorded", recorded), ("simulated", simulated)):
            values = np.sort(getattr(observed, name))
            if len(values):
                share = np.arange(1, len(values) + 1) / len(values)
                shown = f"{source} (n = {len(values):,})"
                axes.step(values, share, where="post", color=_INKS[source], label=shown)
        size = 8 if axes.lines else None  # nothing of this kind may have been seen
        finish(axes, "", size, xlabel=label, ylabel="share", ylim=(0, 1.02))
    _followed(panels[-1], recorded, simulated)
    return drawn


def _followed(axes: Any, recorded: Observed, simulated: Observed) -> None:
    """Draw gap by speed at the moments of following."""
    for source, observed in (("recorded", recorded), ("simulated", simulated)):
        moments = observed.followed
        axes.plot(
            moments.speed,
            moments.gap,
            ".",
            markersize=3,
            color=_INKS[source],
            alpha=0.5,
            label=source,
        )
    finish(axes, "", 8, xlabel="speed, m/s", ylabel="gap to the leader, m", ylim=(0, 60))
