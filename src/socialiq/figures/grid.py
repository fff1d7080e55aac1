"""Figs 6.2 to 6.4, and the trade-off of the 7x7 world that the thesis doesn't show."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.figures.style import COLORS, MARKS, figure, plain
from socialiq.thesis.store import Results, Row

THESIS_ANGLES = {"baseline": 152.0, "egoistic": -42.0, "prosocial": 39.0, "altruistic": 152.0}


def draw(results: Results) -> dict[str, Figure]:
    """All figures of the 7x7 study."""
    return {
        "fig_6_2_ring": ring(results),
        "fig_6_3_experts": heatmaps(results, [f"expert {mode}" for mode in list(COLORS)[1:]]),
        "fig_6_4_learned": heatmaps(results, list(COLORS)),
        "tradeoff": tradeoff(results),
    }


def ring(results: Results) -> Figure:
    """Fig 6.2: the empirical angle of each policy, with the thesis' as an open mark outside."""
    drawn = figure(6.4, 6.0)
    axes = drawn.add_subplot()
    circle = np.radians(np.arange(361))
    axes.plot(np.cos(circle), np.sin(circle), color="#cccccc", linewidth=1.2)
    for degrees in range(0, 360, 45):
        x, y = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        axes.text(0.82 * x, 0.82 * y, f"{degrees}°", ha="center", va="center", color="#888888")
    for name in COLORS:
        ours = results.summary["policies"][f"{name}_greedy"]["angle"]
        label = f"{name}: {ours:.1f}° (thesis {THESIS_ANGLES[name]:.0f}°)"
        # The altruist lies on the baseline; a larger mark below keeps both visible.
        size = 15 if name == "baseline" else 10
        _mark(axes, name, ours, 1.0, size, COLORS[name], label)
        _mark(axes, name, THESIS_ANGLES[name], 1.14, 8, "none", None)
    axes.set(xlim=(-1.35, 1.35), ylim=(-1.35, 1.35), xticks=[], yticks=[])
    axes.set_aspect("equal")
    axes.spines[:].set_visible(False)
    axes.set_xlabel("r_env →")
    axes.set_ylabel("r_social →")
    axes.legend(loc="center", frameon=False, fontsize=8)
    seeds = results.summary["policies"]["baseline_greedy"]["seeds"]
    axes.set_title(f"7x7: empirical angle, greedy, {seeds} seeds (open marks: thesis)", fontsize=10)
    return drawn


def _mark(
    axes: Any, name: str, degrees: float, radius: float, size: int, face: str, label: str | None
) -> None:
    x, y = radius * np.cos(np.radians(degrees)), radius * np.sin(np.radians(degrees))
    axes.plot(
        [x],
        [y],
        linestyle="none",
        marker=MARKS[name],
        markersize=size,
        markerfacecolor=face,
        markeredgecolor=COLORS[name],
        label=label,
    )


def heatmaps(results: Results, policies: list[str]) -> Figure:
    """Figs 6.3 and 6.4: share of STOP in the cell before the conflict, by the vehicles' places.

    Upper row: averaged by the policy's own visits, white where it never comes. Lower row: over
    all reachable states alike, as a table of Q-values would be drawn.
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


def tradeoff(results: Results) -> Figure:
    """What any policy can reach, and where the trained ones lie."""
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
