"""Pictures that the studies of the intersection share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import COLORS, MARKS, figure, plain
from socialiq.types import Row

OUTCOME_COLORS = {"arrival": "#4d9221", "collision": "#c51b7d", "timeout": "#bdbdbd"}


Runs = list[tuple[list[str], Row]]
"""Policies: the parts of the name after the stage, and the row."""


def runs(results: Results, stage: str) -> Runs:
    """The greedy policies of a stage; none if that part was not run."""
    prefix = f"{stage}/"
    return [
        (row["policy"].removeprefix(prefix).split("/"), row)
        for row in results.tables["policies"]
        if row["policy"].startswith(prefix) and row["readout"] == "greedy"
    ]


def percent(rows: Iterable[Row], metric: str) -> list[float]:
    """A share of each row in percent."""
    return [100 * row[metric] for row in rows]


def described(every: Runs) -> str:
    """Over how many seeds and episodes."""
    seeds = len({parts[-1] for parts, _ in every})
    return f"greedy, {seeds} seed{'s'[: seeds != 1]}, {every[0][1]['episodes']} episodes each"


def dots(every: Runs, height: float) -> tuple[Figure, Any]:
    """A row for each first part of the name: a dot for each seed, a bar at their mean."""
    drawn = figure(9.1, height)
    panels = drawn.subplots(1, 2, sharey=True)
    names = list(dict.fromkeys(parts[0] for parts, _ in every))
    for axes, metric in zip(panels, ("collision", "arrival"), strict=True):
        color = OUTCOME_COLORS[metric]
        for place, name in enumerate(names):
            values = percent((row for parts, row in every if parts[0] == name), metric)
            axes.plot(values, [place] * len(values), "o", color=color, alpha=0.6, markersize=6)
            axes.plot([np.mean(values)], [place], "|", color="#333333", markersize=18)
        axes.set_xlabel(f"{metric}s (% of episodes)")
        plain(axes)
    panels[0].set_yticks(range(len(names)), names)
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    panels[0].set_xlim(0, 1.06 * panels[0].get_xlim()[1])
    return drawn, panels


def by_run(results: Results) -> dict[str, list[Row]]:
    """The points of each learning curve."""
    curves: dict[str, list[Row]] = {}
    for row in results.tables["curves"]:
        curves.setdefault(row["run"], []).append(row)
    return curves


def curve(axes: Any, name: str, runs: Sequence[list[Row]], line: str) -> None:
    """The mean over runs, and their range as a light band."""
    if not runs:
        return
    updates = [row["updates"] for row in runs[0]]
    values = np.array([[row["total"] for row in run] for run in runs])
    label = "baseline (value at 0°)" if name == "baseline" else name
    style = {"color": COLORS[name], "marker": MARKS[name], "markersize": 3.5, "linestyle": line}
    axes.plot(updates, values.mean(axis=0), **style, label=label)
    if len(runs) > 1:
        band = {"color": COLORS[name], "alpha": 0.15, "linewidth": 0}
        axes.fill_between(updates, values.min(axis=0), values.max(axis=0), **band)


def with_target(panels: Iterable[Axes], target: Mapping[str, float]) -> None:
    """Draw what a good egoist should reach into a panel of collisions and one of arrivals."""
    for axes, metric in zip(panels, ("collision", "arrival"), strict=True):
        limit = 100 * target[metric]
        axes.axvline(limit, color="#333333", linestyle="--", linewidth=1)
        axes.annotate(
            f"{limit:g} %", (limit, 1), (3, 2), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=8,
        )  # fmt: skip
