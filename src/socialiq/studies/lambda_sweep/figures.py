"""Figs D.1 and D.2: how the regularization strength moves the policy."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import figure, plain
from socialiq.social.angle import angle_of
from socialiq.types import Row

PANELS = {
    "angle": "empirical angle (degrees)",
    "r_env": "mean total r_env",
    "r_social": "mean total r_social",
    "arrival": "success rate",
    "score": "mean total reward R(0°)",
    "length": "episode length (steps)",
}


def draw(results: Results) -> dict[str, Figure]:
    """Draw both figures, for the first target kind in the results."""
    kind = results.config["target_kinds"][0]
    return {"fig_d_1": adaptation(results, kind), "fig_d_2": metrics(results, kind)}


def adaptation(results: Results, kind: str) -> Figure:
    """Fig D.1: the angle over training for each λ, and the updates until it is reached."""
    drawn = figure(11.0, 4.4)
    left, right = drawn.subplots(1, 2)
    rows = _rows(results.tables["checkpoints"], kind, "greedy")
    strengths = sorted({row["strength"] for row in rows})
    colors = matplotlib.colormaps["viridis"](np.linspace(0, 0.95, len(strengths)))
    for strength, color in zip(strengths, colors, strict=True):
        here = [row for row in rows if row["strength"] == strength]
        times = sorted({row["updates"] for row in here})
        angles = [_pooled_angle([row for row in here if row["updates"] == t]) for t in times]
        left.plot(times, angles, color=color, label=f"λ = {strength:g}")
    left.axhline(results.summary["optimum_angle"], color="#c23b22", linestyle=":", linewidth=1)
    left.set(xlabel="updates", ylabel="angle of mean totals (degrees)")
    left.legend(fontsize=7, ncols=2, frameon=False)
    left.set_title(f"greedy, {kind} target (dotted: optimum)", fontsize=10)
    _updates_needed(right, _rows(results.tables["adaptation"], kind, "greedy"), strengths)
    plain(left)
    plain(right)
    return drawn


def _updates_needed(axes: Any, rows: list[Row], strengths: list[float]) -> None:
    kinds = (
        ("first_update_within", "o", "first within"),
        ("settled_update", "_", "within for good"),
    )
    for place, strength in enumerate(strengths):
        here = [row for row in rows if row["strength"] == strength]
        for column, mark, label in kinds:
            reached = [row[column] for row in here if row[column] != ""]
            axes.plot(
                [place] * len(reached),
                reached,
                mark,
                color="#2166ac",
                alpha=0.6,
                markersize=6 if mark == "o" else 14,
                label=label if place == len(strengths) - 1 else None,
            )
        missing = sum(row["first_update_within"] == "" for row in here)
        if missing:
            axes.plot([place], [0], "x", color="#c23b22", markersize=8)
            axes.annotate(
                f"{missing}",
                (place, 0),
                (0, -14),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color="#c23b22",
            )
    axes.set_xticks(range(len(strengths)), [f"{strength:g}" for strength in strengths])
    axes.set_ylim(bottom=-700)
    axes.legend(frameon=False, fontsize=8)
    axes.set(xlabel="λ", ylabel="updates until within 20° of the optimum")
    axes.set_title("a mark for each seed (red: number of seeds that never come)", fontsize=10)


def metrics(results: Results, kind: str) -> Figure:
    """Fig D.2: six metrics against λ; greedy and soft, spread over seeds as dots."""
    drawn = figure(11.0, 6.2)
    axes = drawn.subplots(2, 3).ravel()
    for panel, (name, title) in zip(axes, PANELS.items(), strict=True):
        for readout, color in (("greedy", "#2166ac"), ("soft", "#e08214")):
            means = _rows(results.tables["pooled"], kind, readout)
            each = _rows(results.tables["final"], kind, readout)
            panel.plot(*_series(means, name), color=color, label=readout)
            panel.plot(*_series(each, name), ".", color=color, alpha=0.35)
        panel.set(xlabel="λ", ylabel=title)
        panel.axvline(0.7, color="#999999", linestyle=":", linewidth=1)
        plain(panel)
    axes[0].legend(frameon=False, fontsize=8)
    drawn.suptitle(f"7x7, target 0°, {kind} target (dotted: the thesis' threshold 0.7)")
    return drawn


def _rows(rows: list[Row], kind: str, readout: str) -> list[Row]:
    return [row for row in rows if row["target_kind"] == kind and row["readout"] == readout]


def _series(rows: list[Row], name: str) -> tuple[list[float], list[float]]:
    # At 0 degrees the score R(α) is r_env.
    column = "r_env" if name == "score" else name
    return [row["strength"] for row in rows], [row[column] for row in rows]


def _pooled_angle(rows: list[Row]) -> float:
    env = float(np.mean([row["r_env"] for row in rows]))
    return angle_of(env, float(np.mean([row["r_social"] for row in rows])))
