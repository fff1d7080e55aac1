"""Trade-off of own progress and effect on others: all policies of the main part, and their hull."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from socialiq.plotting.style import COLORS, MARKS, figure, finish
from socialiq.types import Row
from socialiq_lab.intersection import thesis_values
from socialiq_lab.intersection.plots import greedy_runs
from socialiq_lab.results import Results

GROUPS = {
    "thesis/online": ("v", "thesis' preset, online"),
    "calibrated/online": ("s", "calibrated, online"),
    "calibrated/offline": ("o", "calibrated, offline"),
}
"""Mark and title of each group of learners."""

_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
_PLACES = [(far * x, far * y) for far in (1.0, 1.7, 2.4, 3.2) for x, y in _SIDES]
"""Possible places of a label, in its own sizes from its point."""


def tradeoff(results: Results) -> Figure:
    """Draw mean totals of experts, learners and drivers, and their hull for 0° to 90°."""
    drawn = figure(9.1, 6.0)
    axes = drawn.add_subplot()
    best = sorted(_hull(results), reverse=True)
    axes.plot(*zip(*best, strict=True), color="#aaaaaa", linewidth=1.5, zorder=1)
    for group, (mark, _) in GROUPS.items():
        for (target, *_), row in greedy_runs(results, f"learners/{group}"):
            _point(axes, row, mark, COLORS[target], markersize=6, alpha=0.7)
    for (mode, *_), row in greedy_runs(results, "experts/flat"):
        _point(axes, row, "*", COLORS[mode], markersize=14, markeredgecolor="black")
    for mode, signals in thesis_values.TABLE_A_1.items():
        row = {"r_env": signals["g_env"][0], "r_social": signals["g_social"][0]}
        _point(axes, row, MARKS[mode], COLORS[mode], markersize=10, markerfacecolor="none")
    axes.axhline(0, color="#999999", linewidth=0.8)
    axes.axvline(0, color="#999999", linewidth=0.8)
    _legend(drawn)
    seeds, episodes = len(results.config["seeds"]), results.config["episodes"]
    title = f"own progress, effect on others; greedy, {episodes} episodes, {seeds} training seeds"
    finish(
        axes,
        f"Intersection: {title}",
        xlabel="mean total r_env of an episode (own progress)",
        ylabel="mean total r_social of an episode (effect on others)",
    )
    drawn.draw_without_rendering()  # so that distances on the paper are known
    _drivers(axes, results)
    return drawn


def _point(axes: Any, row: Row, mark: str, color: str, **changes: Any) -> None:
    style = {"markeredgewidth": 0.8} if changes.get("markerfacecolor") != "none" else {}
    axes.plot([row["r_env"]], [row["r_social"]], mark, color=color, **(style | changes))


def _hull(results: Results) -> list[tuple[float, float]]:
    """Return the vertices that are the best of all at an angle between 0 and 90 degrees."""
    return [
        (row["r_env"], row["r_social"])
        for row in results.tables["best_angles"]
        if row["best_from"] != ""
        and any(
            row["best_from"] + turn < 90.0 and row["best_to"] + turn > 0.0
            for turn in (-360.0, 0.0, 360.0)
        )
    ]


def _drivers(axes: Any, results: Results) -> None:
    """Draw small grey crosses, each labelled at the nearest free place."""
    names: dict[tuple[float, float], list[str]] = {}  # equal drivers share a label
    for (name,), row in greedy_runs(results, "drivers"):
        _point(axes, row, "x", "#666666", markersize=6, markeredgewidth=1.2, zorder=3)
        names.setdefault((row["r_env"], row["r_social"]), []).append(name)
    points = [one.get_xydata() for one in axes.lines if len(one.get_xdata()) == 1]
    taken = axes.transData.transform(np.concatenate(points))
    pixels = axes.figure.dpi / 72
    for point, same in names.items():
        text = ", ".join(same)
        here, reach = axes.transData.transform(point), pixels * np.array([8 + 2.4 * len(text), 10])
        others = taken[np.abs(taken - here).max(axis=1) > 0.5]
        rooms = [np.abs((others - here) / reach - place).max(axis=1).min() for place in _PLACES]
        free = next((n for n, room in enumerate(rooms) if room >= 1), int(np.argmax(rooms)))
        away = np.array(_PLACES[free]) * reach
        taken = np.vstack([taken, here + away])
        line = {"arrowstyle": "-", "color": "#999999", "linewidth": 0.7, "shrinkA": 0}
        axes.annotate(
            text, point, away / pixels, textcoords="offset points", fontsize=8, color="#444444",
            ha="center", va="center", arrowprops=line if np.abs(_PLACES[free]).max() > 1 else None,
        )  # fmt: skip


def _legend(drawn: Figure) -> None:
    def entry(label: str, color: str = "#444444", mark: str = "", **style: Any) -> Line2D:
        style = {"linestyle": "none", "markersize": 7} | style
        return Line2D([], [], color=color, marker=mark, label=label, **style)

    thesis = {"markerfacecolor": "none", "markersize": 8}
    large = {"markersize": 11, "markeredgecolor": "black"}
    groups = {
        "target or mode": [entry(name, color, "o") for name, color in COLORS.items()],
        "experts and learners": [
            entry("expert", mark="*", **large),
            *(entry(title, mark=mark) for mark, title in GROUPS.values()),
        ],
        "thesis' experts (Table A.1)": [
            entry(mode, COLORS[mode], MARKS[mode], **thesis) for mode in thesis_values.TABLE_A_1
        ],
        "others": [
            entry("rule-based driver", "#666666", "x"),
            entry("hull, best for 0° to 90°", "#aaaaaa", linestyle="-"),
        ],
    }
    handles = [one for head, entries in groups.items() for one in (entry(head), *entries)]
    made = drawn.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=8)
    for text in made.get_texts():
        text.set_fontweight("bold" if text.get_text() in groups else "normal")
