"""Figure of the study: the share of the expert's return of each run."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from socialiq.plotting.style import figure, plain
from socialiq_lab.results import Results
from socialiq_lab.tables import column, groups, matching
from studies.mujoco_imitation.methods import METHODS

_SHADES = (
    "#92c5de", "#4393c3", "#f4a582", "#bdbdbd", "#053061", "#7b3294", "#b2182b", "#4d4d4d",
    "#1b7837", "#7fbf7b", "#000000",
)  # fmt: skip
_COLORS = dict(zip(METHODS, _SHADES, strict=True))


def draw(results: Results) -> dict[str, Figure]:
    """Draw each run's share against the number of trajectories, in a panel for each task."""
    panels = groups(results.tables.get("runs", []), "task")
    if not panels:
        return {}
    drawn = figure(3.4 * len(panels) + 1.0, 4.2)
    for place, ((task,), rows) in enumerate(panels.items(), start=1):
        axes = drawn.add_subplot(1, len(panels), place)
        counts = sorted(set(column(rows, "trajectories")))
        there = [method for method in METHODS if matching(rows, method=method)]
        for shift, method in enumerate(there):
            means: list[tuple[float, float]] = []
            color = _COLORS[method]
            for number, count in enumerate(counts):
                share = column(matching(rows, method=method, trajectories=count), "share")
                x = number + 0.84 * ((shift + 0.5) / len(there) - 0.5)
                axes.plot([x] * len(share), share, "o", color=color, alpha=0.4, markersize=3)
                means += [(x, sum(share) / len(share))] if share else []
            axes.plot(*np.reshape(means, (-1, 2)).T, "_", color=color, markersize=8)
        axes.axhline(1.0, color="0.7", linewidth=0.8, zorder=0)
        axes.set_xticks(range(len(counts)), [str(count) for count in counts])
        axes.set_xlim(-0.5, len(counts) - 0.5)
        for between in range(1, len(counts)):
            axes.axvline(between - 0.5, color="0.85", linewidth=0.8, zorder=0)
        axes.set_xlabel("demonstrated trajectories")
        axes.set_ylim(bottom=min(0.0, *column(rows, "share")))
        axes.set_title(task, fontsize=9)
        plain(axes)
        if place == 1:
            axes.set_ylabel("share of the expert's return")
    names = [method for method in METHODS if matching(results.tables["runs"], method=method)]
    marks = [
        Line2D([], [], color=_COLORS[one], marker="_", linestyle="", label=one) for one in names
    ]
    drawn.legend(handles=marks, frameon=False, fontsize=8, ncols=3, loc="outside lower center")
    return {"shares": drawn}
