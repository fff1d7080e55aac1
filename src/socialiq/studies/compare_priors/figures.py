"""Figures of the comparison: methods by target angle, for each world."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.experiments.tables import column, matching
from socialiq.plotting.style import figure
from socialiq.studies.compare_priors.config import BY_NAME, LABELS
from socialiq.types import Row

TITLES = {"regret": "regret J*(α) - J(α)", "value": "mean total J(α)"}


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw a figure for each world: greedy beside soft."""
    worlds = dict.fromkeys(column(results.tables["pooled"], "world"))
    return {world: _angle_figure(results, world) for world in worlds}


def quantity(results: Results, world: str) -> str:
    """Return the column of a figure: regret where the optimum is known, else the value."""
    rows = matching(results.tables["pooled"], world=world)
    return "value" if "" in column(rows, "regret") else "regret"


def strength(row: Row) -> float | str:
    """Return λ, or 1/τ_w, of a method that has one, else a dash."""
    method = BY_NAME[row["method"]]
    return row["strength"] if method.scaled or method.name == "thesis" else "-"


def _angle_figure(results: Results, world: str) -> Figure:
    """Draw a field for each method and angle: the mean over seeds, and the range if it differs."""
    rows = matching(results.tables["pooled"], world=world)
    name = quantity(results, world)
    methods = list(dict.fromkeys(column(rows, "method")))
    angles = sorted(set(column(rows, "target_angle")))
    drawn = figure(3.4 + 1.5 * len(angles), 1.4 + 0.42 * len(methods))
    panels = drawn.subplots(1, 2, sharey=True)
    values = column(rows, name)
    norm: Normalize = Normalize(min(values), max(values))
    colors = matplotlib.colormaps["viridis"]
    if name == "regret":  # small regrets matter, and differ by orders of magnitude
        norm, colors = PowerNorm(0.4, 0.0, max(max(values), 1e-6)), colors.reversed()
    image: Any = None
    for axes, readout in zip(panels, ("greedy", "soft"), strict=True):
        picture = np.full((len(methods), len(angles)), np.nan)
        for row in rows:
            if row["readout"] == readout:
                place = methods.index(row["method"]), angles.index(row["target_angle"])
                picture[place] = row[name]
                _write(axes, place, row, name, colors(norm(row[name])))
        image = axes.imshow(picture, aspect="auto", norm=norm, cmap=colors)
        axes.set_xticks(range(len(angles)), [f"{angle:g}" for angle in angles])
        axes.set_xlabel("target angle (degrees)")
        axes.set_title(readout, fontsize=10)
    panels[0].set_yticks(range(len(methods)), [_label(rows, method) for method in methods])
    bar = drawn.colorbar(image, ax=panels, label=f"{TITLES[name]} (units of reward)", shrink=0.7)
    if name == "regret":
        top = max(values)
        bar.set_ticks([tick for tick in (0, 0.1, 0.5, 1, 2, 5, 10, 20) if tick <= top])
    seeds = rows[0]["seeds"]
    drawn.suptitle(f"{world}: mean over {seeds} seeds, below it the range of seeds", fontsize=11)
    return drawn


def _label(rows: list[Row], method: str) -> str:
    scale = strength(next(row for row in rows if row["method"] == method))
    if scale == "-":
        return LABELS[method]
    sign = "1/τ_w" if method in ("reweighting", "clone_weighted") else "λ"
    return f"{LABELS[method]} ({sign} = {scale:g})"


def _write(axes: Any, place: tuple[int, int], row: Row, name: str, color: Any) -> None:
    """Write the number in its field, dark on light and light on dark."""
    line, column = place
    text = f"{_short(row[name])}"
    if row[f"{name}_high"] - row[f"{name}_low"] >= 0.005:
        text += f"\n{_short(row[f'{name}_low'])} to {_short(row[f'{name}_high'])}"
    light = sum(part * c for part, c in zip((0.3, 0.6, 0.1), color[:3], strict=True))
    ink = "black" if light > 0.5 else "white"
    axes.text(column, line, text, ha="center", va="center", fontsize=6, color=ink)


def _short(value: float) -> str:
    text = f"{value:.2f}"
    return "0" if text in ("0.00", "-0.00") else text
