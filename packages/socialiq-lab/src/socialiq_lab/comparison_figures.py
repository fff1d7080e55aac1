"""Figure of a comparison: a field for each method and target angle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure

from socialiq.plotting.style import figure
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq_lab.tables import column, matching

TITLES = {"regret": "regret J*(α) - J(α)", "value": "mean total J(α)"}


def quantity(results: Results, world: str) -> str:
    """Return the column of a figure: regret where the optimum is known, else the value."""
    rows = matching(results.tables["pooled"], world=world)
    return "value" if "" in column(rows, "regret") else "regret"


def angle_figure(
    results: Results,
    world: str,
    labels: Mapping[str, str],
    readouts: Sequence[str] = ("greedy", "soft"),
) -> Figure:
    """Draw a field for each method and angle: the mean over seeds, and the range if it differs.

    Args:
        results: With a table `pooled` of `comparison.means`.
        world: The world.
        labels: Label of each method.
        readouts: Action selections, a panel for each.
    """
    rows = matching(results.tables["pooled"], world=world)
    rows = [row for row in rows if row["readout"] in readouts]
    name = quantity(results, world)
    methods = list(dict.fromkeys(column(rows, "method")))
    angles = sorted(set(column(rows, "target_angle")))
    picture_figure = figure(3.4 + 0.75 * len(readouts) * len(angles), 1.4 + 0.42 * len(methods))
    panels = np.ravel(picture_figure.subplots(1, len(readouts), sharey=True, squeeze=False))
    norm, colors = _colors(column(rows, name), name)
    image: Any = None
    for axes, readout in zip(panels, readouts, strict=True):
        picture = np.full((len(methods), len(angles)), np.nan)
        for row in matching(rows, readout=readout):
            cell = methods.index(row["method"]), angles.index(row["target_angle"])
            picture[cell] = row[name]
            _write(axes, cell, row, name, colors(norm(row[name])))
        image = axes.imshow(picture, aspect="auto", norm=norm, cmap=colors)
        axes.set_xticks(range(len(angles)), [f"{angle:g}" for angle in angles])
        axes.set_xlabel("target angle (degrees)")
        axes.set_title(readout, fontsize=10)
    panels[0].set_yticks(range(len(methods)), [labels[method] for method in methods])
    bar = picture_figure.colorbar(
        image, ax=list(panels), label=f"{TITLES[name]} (units of reward)", shrink=0.7
    )
    if name == "regret":
        top = max(column(rows, name))
        bar.set_ticks([tick for tick in (0, 0.1, 0.5, 1, 2, 5, 10, 20) if tick <= top])
    seeds = rows[0]["seeds"]
    picture_figure.suptitle(
        f"{world}: mean over {seeds} seeds, below it the range of seeds", fontsize=11
    )
    return picture_figure


def _colors(values: Sequence[float], name: str) -> tuple[Normalize, Any]:
    if name == "regret":  # small regrets matter, and differ by orders of magnitude
        return PowerNorm(0.4, 0.0, max(max(values), 1e-6)), matplotlib.colormaps[
            "viridis"
        ].reversed()
    return Normalize(min(values), max(values)), matplotlib.colormaps["viridis"]


def _write(axes: Any, cell: tuple[int, int], row: Row, name: str, color: Any) -> None:
    """Write the number in its field, dark on light and light on dark."""
    line, column = cell
    text = f"{_short(row[name])}"
    if row[f"{name}_high"] - row[f"{name}_low"] >= 0.005:
        text += f"\n{_short(row[f'{name}_low'])} to {_short(row[f'{name}_high'])}"
    light = sum(share * c for share, c in zip((0.3, 0.6, 0.1), color[:3], strict=True))
    ink = "black" if light > 0.5 else "white"
    axes.text(column, line, text, ha="center", va="center", fontsize=6, color=ink)


def _short(value: float) -> str:
    text = f"{value:.2f}"
    return "0" if text in ("0.00", "-0.00") else text
