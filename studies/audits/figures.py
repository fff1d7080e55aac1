"""Verdicts on declared angles: regrets against the margin, and which test decided."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from socialiq.plotting.style import figure, head, plain
from socialiq.types import Row
from socialiq_lab.results import Results
from socialiq_lab.tables import groups

_COLORS = {"pass": "#1b7837", "inconclusive": "#8a6d00", "fail": "#c23b22"}
_MARKS = {"pass": "o", "inconclusive": "s", "fail": "X"}
_FARTHEST = 6.0  # margins; an arrow marks regrets beyond


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw each audit's regret in margins with bounds, in the colour and mark of its verdict."""
    rows = results.tables["audits"]
    worlds = groups(rows, "world")
    drawn = figure(9.6, 1.4 + 0.27 * len(rows))
    heights = [len(part) for part in worlds.values()]
    axes = drawn.subplots(len(worlds), 1, squeeze=False, height_ratios=heights)
    for ((world,), part), panel in zip(worlds.items(), axes[:, 0], strict=True):
        _draw_panel(panel, part)
        panel.set_title(world, fontsize=10, loc="left")
    axes[-1, 0].set_xlabel("regret at the declared angle, in margins (1 is allowed)")
    for verdict, color in _COLORS.items():
        axes[0, 0].plot([], [], _MARKS[verdict], color=color, label=verdict)
    episodes = results.config["episodes"]
    head(drawn, f"{len(rows)} audits of {episodes:,} episodes each", axes[0, 0])
    return {"audits": drawn}


def _draw_panel(axes: Any, rows: list[Row]) -> None:
    axes.axvline(1, color="#444444", linewidth=0.9)
    for place, row in enumerate(rows):
        low, mean, high = (
            row[name] / row["margin"] for name in ("regret_low", "regret", "regret_high")
        )
        color = _COLORS[row["verdict"]]
        axes.plot([low, min(high, _FARTHEST)], [place] * 2, color=color, linewidth=1.4)
        mark = _MARKS[row["verdict"]] if mean <= _FARTHEST else ">"
        axes.plot([min(mean, _FARTHEST)], [place], mark, color=color, markersize=6)
        if row["decided_by"]:
            text = row["decided_by"].replace("_", " ")
            axes.annotate(text, (1.005, place), xycoords=("axes fraction", "data"),
                          fontsize=7, color=color, va="center")  # fmt: skip
    axes.set_yticks(range(len(rows)), [_label(row) for row in rows], fontsize=8)
    axes.set_xlim(-2.2, _FARTHEST + 0.2)
    axes.invert_yaxis()
    plain(axes)


def _label(row: Row) -> str:
    false = "" if row["truthful"] else " (falsely)" if row["made_for"] != "" else " (made for none)"
    return f"{row['policy']}, as {row['declared']:g}°{false}"
