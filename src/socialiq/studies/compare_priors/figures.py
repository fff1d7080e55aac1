"""The comparison of priors as pictures: methods by target angle, one for each world."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import figure
from socialiq.studies.compare_priors.methods import BY_NAME, LABELS
from socialiq.types import Row

TITLES = {"regret": "regret J*(α) - J(α)", "value": "mean total J(α)"}


def draw(results: Results) -> dict[str, Figure]:
    """One figure for each world: greedy beside soft."""
    worlds = dict.fromkeys(row["world"] for row in results.tables["pooled"])
    return {world: by_angle(results, world) for world in worlds}


def quantity(results: Results, world: str) -> str:
    """Regret where the optimum is known, else the value."""
    rows = [row for row in results.tables["pooled"] if row["world"] == world]
    return "value" if any(row["regret"] == "" for row in rows) else "regret"


def strength(row: Row) -> float | str:
    """λ, or 1/τ_w, of a method that has one."""
    method = BY_NAME[row["method"]]
    return row["strength"] if method.scaled or method.name == "thesis" else "-"


def by_angle(results: Results, world: str) -> Figure:
    """A field for each method and target angle; the number is the mean over seeds.

    Below it stand the least and the greatest of a seed, where they differ.
    """
    rows = [row for row in results.tables["pooled"] if row["world"] == world]
    shown = quantity(results, world)
    methods = list(dict.fromkeys(row["method"] for row in rows))
    angles = sorted({row["target_angle"] for row in rows})
    drawn = figure(3.4 + 1.5 * len(angles), 1.4 + 0.42 * len(methods))
    panels = drawn.subplots(1, 2, sharey=True)
    values = [row[shown] for row in rows]
    norm: Normalize = Normalize(min(values), max(values))
    colors = matplotlib.colormaps["viridis"]
    if shown == "regret":  # small regrets matter, and differ by orders of magnitude
        norm, colors = PowerNorm(0.4, 0.0, max(max(values), 1e-6)), colors.reversed()
    image: Any = None
    for axes, readout in zip(panels, ("greedy", "soft"), strict=True):
        picture = np.full((len(methods), len(angles)), np.nan)
        for row in rows:
            if row["readout"] == readout:
                place = methods.index(row["method"]), angles.index(row["target_angle"])
                picture[place] = row[shown]
                _write(axes, place, row, shown, colors(norm(row[shown])))
        image = axes.imshow(picture, aspect="auto", norm=norm, cmap=colors)
        axes.set_xticks(range(len(angles)), [f"{angle:g}" for angle in angles])
        axes.set_xlabel("target angle (degrees)")
        axes.set_title(readout, fontsize=10)
    panels[0].set_yticks(range(len(methods)), [_label(rows, method) for method in methods])
    bar = drawn.colorbar(image, ax=panels, label=f"{TITLES[shown]} (units of reward)", shrink=0.7)
    if shown == "regret":
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


def _write(axes: Any, place: tuple[int, int], row: Row, shown: str, color: Any) -> None:
    """The number in its field, dark on light and light on dark."""
    line, column = place
    text = f"{_short(row[shown])}"
    if row[f"{shown}_high"] - row[f"{shown}_low"] >= 0.005:
        text += f"\n{_short(row[f'{shown}_low'])} to {_short(row[f'{shown}_high'])}"
    light = sum(part * c for part, c in zip((0.3, 0.6, 0.1), color[:3], strict=True))
    ink = "black" if light > 0.5 else "white"
    axes.text(column, line, text, ha="center", va="center", fontsize=6, color=ink)


def _short(value: float) -> str:
    text = f"{value:.2f}"
    return "0" if text in ("0.00", "-0.00") else text
