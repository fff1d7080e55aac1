"""Figures and printed tables of the study."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from socialiq.plotting.style import figure, plain
from socialiq_lab.results import Results
from socialiq_lab.study import View
from socialiq_lab.tables import column, groups, matching

_COLORS = ("#7f7f7f", "#2166ac", "#e08214", "#053061", "#7f3b08", "#bdbdbd", "#1b7837", "#00441b")


def draw(results: Results) -> dict[str, Figure]:
    """Draw the return of each policy, by method, in a panel for each kind of data."""
    panels = groups(results.tables["returns"], "task", "protocol", "trajectories")
    columns = 2
    lines = -(-len(panels) // columns)
    drawn = figure(9.6, 3.0 * lines)
    for place, (label, rows) in enumerate(panels.items(), start=1):
        axes = drawn.add_subplot(lines, columns, place)
        methods = list(dict.fromkeys(column(rows, "method")))
        for number, method in enumerate(methods):
            single = [row for row in matching(rows, method=method) if row["seed"] != "ensemble"]
            values = column(single, "mean_return")
            color = _COLORS[number % len(_COLORS)]
            axes.plot(values, [number] * len(values), "o", color=color, alpha=0.4, markersize=4)
            axes.plot([sum(values) / len(values)], [number], "|", color=color, markersize=16)
        axes.set_yticks(range(len(methods)), methods, fontsize=7)
        axes.invert_yaxis()
        count = "1 trajectory" if label[2] == 1 else f"{label[2]} trajectories"
        axes.set_title(f"{label[0]}, {label[1]}, {count}", fontsize=9)
        axes.set_xlabel("mean return", fontsize=8)
        plain(axes)
    return {"returns": drawn}


def views(results: Results) -> Sequence[View]:
    """Return the tables to print."""
    tables = results.tables
    shown = [View(_narrow(tables["pooled"]), "Over all sets of demonstrations and seeds")]
    if "differences" in tables:
        shown.append(View(tables["differences"], "Pairs of methods, over sets of demonstrations"))
    if "ablation_returns" in tables:
        shown.append(
            View(_narrow(tables["ablations"]), "CartPole, one row of each block, one changed")
        )
    return shown


def _narrow(rows: Sequence[dict]) -> list[dict]:
    hidden = ("best", "deviation_of_sets")
    return [{name: value for name, value in row.items() if name not in hidden} for row in rows]
