"""Scores with a skill that the reward pair lacks, in the intersection, by angle."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from socialiq.plotting.rows import band, line
from socialiq.plotting.style import figure, finish
from socialiq_lab.results import Results
from socialiq_lab.tables import groups, matching
from studies.intersection_skill.plan import (
    ALONE,
    CLONES,
    EXPERTS,
    FOLDERS,
    IMPROVED,
    INFERRED,
    PRIOR,
    REFERENCES,
    RETURNS,
    SHARED,
    TURNED,
    UNSKILLED,
)

_LOOKS = {
    IMPROVED: ("#1b7837", "o"),
    TURNED: ("#7fbf7b", "s"),
    SHARED: ("#2166ac", "o"),
    INFERRED: ("#67a9cf", "s"),
    RETURNS: ("#e08214", "^"),
    PRIOR: ("#b2abd2", "v"),
    ALONE: ("#c23b22", "D"),
    CLONES: ("#6e6e6e", "x"),
    EXPERTS: ("#000000", "*"),
    UNSKILLED: ("#8c510a", "+"),
}
"""Colour and mark of each method; references are drawn at demonstrated angles only."""


def draw(results: Results) -> dict[str, Figure]:
    """Draw scores by angle, their parts, and learning curves."""
    found = {"scores": _scores(results), "parts": _parts(results)}
    return found | ({"learning": _learning(results)} if "curves" in results.tables else {})


def _scores(results: Results) -> Figure:
    """Draw R(α) + c h over the angle."""
    drawn = figure(8.6, 5.0)
    axes = drawn.subplots()
    _bands(axes, results, "score")
    xlabel = "angle, degrees (0, 45 and 90 are demonstrated)"
    title = "Mean over training seeds, band from least to largest"
    finish(axes, title, 8, xlabel=xlabel, ylabel="R(α) + c h, an episode")
    return drawn


def _parts(results: Results) -> Figure:
    """Draw the given reward and the hidden skill over the angle."""
    drawn = figure(10.0, 4.4)
    left, right = drawn.subplots(1, 2)
    _bands(left, results, "told")
    _bands(right, results, "skill")
    xlabel = "angle, degrees"
    finish(left, "reward given to every method", xlabel=xlabel, ylabel="R(α), an episode")
    title = "skill, rewarded in demonstrators only"
    finish(right, title, 7, xlabel=xlabel, ylabel="h, an episode")
    return drawn


def _bands(axes: Any, results: Results, name: str) -> None:
    for method, (color, mark) in _LOOKS.items():
        rows = matching(results.tables["scores"], method=method)
        if method in REFERENCES:
            rows = matching(rows, demonstrated=1)
        if rows:
            style = "none" if method in REFERENCES else "-"
            band(axes, rows, "angle", name, color=color, marker=mark, label=method, linestyle=style)


def _learning(results: Results) -> Figure:
    """Draw R(α) + c h of each dial while it trains: the mean over the demonstrated angles."""
    drawn = figure(7.0, 4.2)
    axes = drawn.subplots()
    colors = {FOLDERS[method]: color for method, (color, _) in _LOOKS.items()}
    for (run,), rows in groups(results.tables["curves"], "run").items():
        color = colors[run.split("/")[0]]
        line(axes, rows, "updates", "total", color=color, linewidth=0.9, alpha=0.7)
    title = "Dials while they train, colours as in the scores"
    finish(axes, title, xlabel="updates", ylabel="R(α) + c h, mean of 0°, 45°, 90°")
    return drawn
