"""Figs 6.2 to 6.4, and the trade-off of the 7x7 world that the thesis doesn't show."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.plotting.ring import Mark, ring
from socialiq.plotting.style import COLORS, MARKS, figure, plain
from socialiq.types import Row
from socialiq_lab.results import Results

THESIS_ANGLES = {"baseline": 152.0, "egoistic": -42.0, "prosocial": 39.0, "altruistic": 152.0}


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw all figures of the 7x7 study."""
    return {
        "fig_6_2_ring": _ring(results),
        "fig_6_3_experts": _heatmaps(results, [f"expert {mode}" for mode in list(COLORS)[1:]]),
        "fig_6_4_learned": _heatmaps(results, list(COLORS)),
        "tradeoff": _tradeoff(results),
    }


def _ring(results: Results) -> Figure:
    """Draw Fig 6.2: the empirical angle of each policy, the thesis' as an open mark outside."""
    entries = {name: results.summary["policies"][f"{name}_greedy"] for name in COLORS}
    marks = []
    for name, entry in entries.items():
        thesis = THESIS_ANGLES[name]
        label = f"{name}: {entry['angle']:.1f}° (thesis {thesis:.0f}°)"
        marks.append(Mark(name, entry["angle"], label, thesis))
    seeds = entries["baseline"]["seeds"]
    return ring(marks, f"7x7: empirical angle, greedy, {seeds} seeds (open marks: thesis)")


def _heatmaps(results: Results, policies: list[str]) -> Figure:
    """Draw Figs 6.3 and 6.4: share of STOP in the cell before the conflict by the vehicles' places.

    Upper row: averaged by the policy's visits, white where it has none. Lower row: averaged over
    all reachable states, as a table of Q-values would be drawn.
    """
    drawn = figure(2.6 * len(policies) + 0.8, 5.6)
    axes = drawn.subplots(2, len(policies), sharex=True, sharey=True, squeeze=False)
    images = []
    for column, name in enumerate(policies):
        for row, kind in enumerate(("weighted", "unweighted")):
            images.append(_heatmap(axes[row][column], results.tables["heatmaps"], name, kind))
        axes[0][column].set_title(name)
        axes[1][column].set_xlabel("vehicle 2 at y (-1: none)")
    axes[0][0].set_ylabel("vehicle 1 at y\nby visits")
    axes[1][0].set_ylabel("vehicle 1 at y\nall reachable states")
    drawn.colorbar(images[0], ax=axes, label="share of STOP before the conflict", shrink=0.7)
    return drawn


def _heatmap(axes: Any, rows: list[Row], name: str, kind: str) -> Any:
    picture = np.full((8, 8), np.nan)
    for row in rows:
        if row["policy"] == name and row[kind] != "":
            picture[row["y_1"] + 1, row["y_2"] + 1] = row[kind]
    image = axes.imshow(
        picture, origin="lower", extent=(-1.5, 6.5, -1.5, 6.5), vmin=0, vmax=1, cmap="viridis"
    )
    axes.set_xticks(range(-1, 7))
    axes.set_yticks(range(-1, 7))
    axes.set_ylim(-0.5, 6.5)
    return image


def _tradeoff(results: Results) -> Figure:
    """Draw the rewards of the trained policies and the exact optima."""
    drawn = figure(6.8, 5.2)
    axes = drawn.add_subplot()
    plain(axes)
    best = results.tables["attainable"]
    axes.plot(
        [row["optimum_r_env"] for row in best],
        [row["optimum_r_social"] for row in best],
        color="#bbbbbb",
        marker=".",
        label="optima for 0° to 90°, exact",
        zorder=1,
    )
    for name, color in COLORS.items():
        for readout, face in (("greedy", color), ("soft", "white")):
            entry = results.summary["policies"][f"{name}_{readout}"]
            axes.plot(
                [entry["r_env"]],
                [entry["r_social"]],
                linestyle="none",
                marker=MARKS[name],
                markersize=13 if name == "baseline" else 9,
                markerfacecolor=face,
                markeredgecolor=color,
                label=f"{name}, {readout}",
            )
    axes.axhline(0, color="#999999", linewidth=0.8)
    axes.axvline(0, color="#999999", linewidth=0.8)
    axes.set_xlabel("mean total r_env (own progress)")
    axes.set_ylabel("mean total r_social (effect on others)")
    axes.legend(frameon=False, fontsize=8, loc="upper right")
    axes.set_title("7x7: one mixed data set, four policies, and the exact front", fontsize=10)
    return drawn
