"""Scores with a skill that the reward pair doesn't speak of, in the intersection, by angle."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.experiments.tables import matching
from socialiq.plotting.rows import band
from socialiq.plotting.style import figure, plain

_LOOKS = {
    "shared competence": ("#2166ac", "o"),
    "shared competence, angles inferred": ("#67a9cf", "s"),
    "prior on returns-to-go": ("#e08214", "^"),
    "prior on rewards": ("#b2abd2", "v"),
    "RL on R(α)": ("#c23b22", "D"),
    "clones": ("#6e6e6e", "x"),
    "demonstrators": ("#000000", "*"),
    "experts of R(α) alone": ("#8c510a", "+"),
}
_ONE_EACH = ("clones", "demonstrators", "experts of R(α) alone")
"""They have one policy for each demonstrated angle, and are drawn there alone."""


def draw(results: Results) -> dict[str, Figure]:
    """Scores by angle, and what they are made of."""
    found = {"scores": _scores(results), "parts": _parts(results)}
    return found | ({"learning": _learning(results)} if "curves" in results.tables else {})


def _scores(results: Results) -> Figure:
    """R(α) + c h over the angle."""
    drawn = figure(8.6, 5.0)
    axes = drawn.subplots()
    _draw(axes, results, "score")
    axes.set(
        xlabel="angle, degrees (0, 45 and 90 are demonstrated)", ylabel="R(α) + c h, an episode"
    )
    axes.set_title("Mean over training seeds, band from least to largest", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    plain(axes)
    return drawn


def _parts(results: Results) -> Figure:
    """Signals that were given, and the hidden one."""
    drawn = figure(10.0, 4.4)
    for axes, (name, label) in zip(
        drawn.subplots(1, 2), {"told": "R(α)", "skill": "h"}.items(), strict=True
    ):
        _draw(axes, results, name)
        axes.set(xlabel="angle, degrees", ylabel=f"{label}, an episode")
        plain(axes)
    drawn.axes[0].set_title("what methods are told", fontsize=10)
    drawn.axes[1].set_title("what demonstrators alone are told", fontsize=10)
    drawn.axes[1].legend(frameon=False, fontsize=7)
    return drawn


def _draw(axes: object, results: Results, name: str) -> None:
    for method, (color, mark) in _LOOKS.items():
        rows = matching(results.tables["scores"], method=method)
        if method in _ONE_EACH:
            rows = matching(rows, demonstrated=1)
        if rows:
            style = "none" if method in _ONE_EACH else "-"
            band(axes, rows, "angle", name, color=color, marker=mark, label=method, linestyle=style)


def _learning(results: Results) -> Figure:
    """R(α) + c h of each dial while it trains: mean over the demonstrated angles."""
    drawn = figure(7.0, 4.2)
    axes = drawn.subplots()
    colors = {
        "alone": _LOOKS["RL on R(α)"],
        "prior": _LOOKS["prior on rewards"],
        "shared": _LOOKS["shared competence"],
        "inferred": _LOOKS["shared competence, angles inferred"],
    }
    curves = results.tables["curves"]
    for name in dict.fromkeys(row["run"] for row in curves):
        rows = matching(curves, run=name)
        updates, totals = ([row[key] for row in rows] for key in ("updates", "total"))
        axes.plot(updates, totals, color=colors[name.split("/")[0]][0], linewidth=0.9, alpha=0.7)
    axes.set(xlabel="updates", ylabel="R(α) + c h, mean of 0°, 45°, 90°")
    axes.set_title("Dials while they train, colours as in the scores", fontsize=10)
    plain(axes)
    return drawn
