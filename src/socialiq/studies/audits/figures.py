"""Verdicts on declared angles: regrets against the margin, and which test decided."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import figure, plain
from socialiq.types import Row

_COLORS = {"pass": "#1b7837", "inconclusive": "#8a6d00", "fail": "#c23b22"}
_MARKS = {"pass": "o", "inconclusive": "s", "fail": "X"}
_FARTHEST = 6.0  # margins; beyond, an arrow


def draw(results: Results) -> dict[str, Figure]:
    """The study's figure."""
    return {"audits": audits(results)}


def audits(results: Results) -> Figure:
    """Each audit's regret in margins, with its bounds; in colour and mark the whole verdict."""
    rows = results.tables["audits"]
    worlds = list(dict.fromkeys(row["world"] for row in rows))
    parts = [[row for row in rows if row["world"] == world] for world in worlds]
    drawn = figure(9.6, 1.4 + 0.27 * len(rows))
    axes = drawn.subplots(len(worlds), 1, squeeze=False, height_ratios=[len(one) for one in parts])
    for world, part, one in zip(worlds, parts, axes[:, 0], strict=True):
        _panel(one, part)
        one.set_title(world, fontsize=10, loc="left")
    axes[-1, 0].set_xlabel("regret at the declared angle, in margins (1 is allowed)")
    for verdict, color in _COLORS.items():
        axes[0, 0].plot([], [], _MARKS[verdict], color=color, label=verdict)
    drawn.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    episodes = results.config["episodes"]
    drawn.suptitle(f"{len(rows)} audits of {episodes:,} episodes each", fontsize=10)
    return drawn


def _panel(axes: Any, rows: list[Row]) -> None:
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
    axes.set_yticks(range(len(rows)), [_named(row) for row in rows], fontsize=8)
    axes.set_xlim(-2.2, _FARTHEST + 0.2)
    axes.invert_yaxis()
    plain(axes)


def _named(row: Row) -> str:
    false = "" if row["truthful"] else " (falsely)" if row["made_for"] != "" else " (made for none)"
    return f"{row['policy']}, as {row['declared']:g}°{false}"
