"""Figures of the comparison: methods by target angle, for each world."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.types import Row
from socialiq_lab.comparison_figures import angle_figure
from socialiq_lab.results import Results
from socialiq_lab.tables import column, matching
from studies.compare_priors.config import BY_NAME, LABELS


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw a figure for each world: greedy beside soft."""
    worlds = dict.fromkeys(column(results.tables["pooled"], "world"))
    return {world: angle_figure(results, world, _labels(results, world)) for world in worlds}


def strength(row: Row) -> float | str:
    """Return λ, or 1/τ_w, of a method that has one, else a dash."""
    method = BY_NAME[row["method"]]
    return row["strength"] if method.scaled or method.name == "thesis" else "-"


def _labels(results: Results, world: str) -> dict[str, str]:
    rows = matching(results.tables["pooled"], world=world)
    return {method: _label(rows, method) for method in dict.fromkeys(column(rows, "method"))}


def _label(rows: list[Row], method: str) -> str:
    scale = strength(next(row for row in rows if row["method"] == method))
    if scale == "-":
        return LABELS[method]
    sign = "1/τ_w" if method in ("reweighting", "clone_weighted") else "λ"
    return f"{LABELS[method]} ({sign} = {scale:g})"
