"""Figures that the studies of the intersection share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from socialiq.plotting.style import COLORS, MARKS, band, figure, finish, plain
from socialiq.types import Row
from socialiq_lab.results import Results

OUTCOME_COLORS = {"arrival": "#4d9221", "collision": "#c51b7d", "timeout": "#bdbdbd"}

Runs = list[tuple[list[str], Row]]
"""Policies: the parts of the name after the stage, and the row."""


def greedy_runs(results: Results, stage: str) -> Runs:
    """Return the greedy policies of a stage; none if that part was not run."""
    prefix = f"{stage}/"
    return [
        (row["policy"].removeprefix(prefix).split("/"), row)
        for row in results.tables["policies"]
        if row["policy"].startswith(prefix) and row["readout"] == "greedy"
    ]


def percent(rows: Iterable[Row], metric: str) -> list[float]:
    """Return a share of each row in percent."""
    return [100 * row[metric] for row in rows]


def seeds_and_episodes(runs: Runs) -> str:
    """Return the number of seeds and episodes of greedy policies, for a title."""
    seeds = len({parts[-1] for parts, _ in runs})
    return f"greedy, {seeds} seed{'s'[: seeds != 1]}, {runs[0][1]['episodes']} episodes each"


def dots(runs: Runs, height: float) -> Figure:
    """Draw collisions and arrivals: a dot for each seed, a bar at their mean.

    Args:
        runs: Policies; the first part of the name makes a row of dots.
        height: Height of the figure in inches.
    """
    drawn = figure(9.1, height)
    panels = drawn.subplots(1, 2, sharey=True)
    names = list(dict.fromkeys(parts[0] for parts, _ in runs))
    for axes, metric in zip(panels, ("collision", "arrival"), strict=True):
        color = OUTCOME_COLORS[metric]
        for place, name in enumerate(names):
            values = percent((row for parts, row in runs if parts[0] == name), metric)
            axes.plot(values, [place] * len(values), "o", color=color, alpha=0.6, markersize=6)
            axes.plot([np.mean(values)], [place], "|", color="#333333", markersize=18)
        axes.set_xlabel(f"{metric}s (% of episodes)")
        plain(axes)
    panels[0].set_yticks(range(len(names)), names)
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    panels[0].set_xlim(0, 1.06 * panels[0].get_xlim()[1])
    return drawn


def stacked_outcomes(axes: Any, rows: Mapping[str, Row], least: float) -> None:
    """Draw a bar of outcomes in percent for each named row, with a number on wide parts.

    Args:
        axes: Where to draw.
        rows: Rows with a share of each outcome.
        least: Width from which a part has its number.
    """
    left = np.zeros(len(rows))
    for outcome, color in OUTCOME_COLORS.items():
        widths = np.array(percent(rows.values(), outcome))
        bars = axes.barh(list(rows), widths, left=left, color=color, label=outcome)
        labels = [f"{width:.0f}" if width >= least else "" for width in widths]
        axes.bar_label(bars, labels, label_type="center", fontsize=8)
        left += widths
    axes.set(xlabel="% of episodes", xlim=(0, 100))


def learning_panel(
    axes: Any, results: Results, folder: str, names: Sequence[str], title: str, **properties: Any
) -> None:
    """Draw learning curves: means over the runs of each policy, and their ranges as bands.

    Args:
        axes: Where to draw.
        results: Results with a table of curves.
        folder: Folder of the policies' jobs.
        names: Names of the policies there.
        title: Title of the panel.
        **properties: Properties of the panel.
    """
    for name in names:
        rows = [
            row for row in results.tables["curves"] if row["run"].startswith(f"{folder}/{name}/")
        ]
        label = "baseline (value at 0°)" if name == "baseline" else name
        style = {"color": COLORS[name], "marker": MARKS[name], "markersize": 3.5}
        if rows:
            band(axes, rows, "updates", "total", **style, label=label)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.xaxis.set_major_formatter(lambda updates, _: f"{updates:,.0f}")
    finish(axes, title, xlabel="updates", **properties)
