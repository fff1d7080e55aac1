"""Scores with a skill that the reward pair doesn't speak of, by method and angle."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.experiments.tables import matching
from socialiq.plotting.rows import band
from socialiq.plotting.style import COLORS, figure, plain
from socialiq.studies.competence.study import best_strengths

_LOOKS = {
    "shared competence": ("#2166ac", "o"),
    "shared competence, angles inferred": ("#67a9cf", "s"),
    "prior on returns-to-go": ("#e08214", "^"),
    "prior on rewards": ("#b2abd2", "v"),
    "IQ-Learn, no prior": ("#6e6e6e", "x"),
    "RL on R(α)": ("#c23b22", "D"),
}


def draw(results: Results) -> dict[str, Figure]:
    """Greedy score by angle, and how the angles were inferred."""
    return {"scores": _scores(results), "angles": _angles(results)}


def _scores(results: Results) -> Figure:
    drawn = figure(8.6, 4.6)
    axes = drawn.subplots()
    strengths = best_strengths(results.tables["pooled"])
    for method, (color, mark) in _LOOKS.items():
        rows = matching(
            results.tables["scores"], method=method, strength=strengths[method], readout="greedy"
        )
        named = f" (best λ: {strengths[method]:g})" if strengths[method] != "" else ""
        band(axes, rows, "angle", "score", color=color, marker=mark, label=method + named)
    axes.set(xlabel="angle, degrees (0, 45 and 90 are demonstrated)", ylabel="score")
    axes.set_title("1: optimal for R(α) and comfort; 0: even chances. Band: all data sets")
    axes.set_xticks(sorted({row["angle"] for row in results.tables["scores"]}))
    axes.legend(frameon=False, fontsize=8)
    plain(axes)
    return drawn


def _angles(results: Results) -> Figure:
    drawn = figure(6.0, 3.8)
    axes = drawn.subplots()
    rows = results.tables["angles"]
    for mode in dict.fromkeys(row["mode"] for row in rows):
        color = COLORS[mode]
        for seed in sorted({row["seed"] for row in rows}):
            path = matching(rows, mode=mode, seed=seed)
            axes.plot(
                [row["round"] for row in path],
                [row["mean"] for row in path],
                color=color,
                alpha=0.5,
            )
        true = next(row["true_angle"] for row in rows if row["mode"] == mode)
        axes.axhline(true, color=color, linestyle=":", label=f"{mode}: {true:g}°")
    axes.set(xlabel="round of expectation-maximisation", ylabel="inferred angle, degrees")
    axes.set_title("Demonstrators' angles, inferred beside what they share")
    axes.legend(loc="center left", bbox_to_anchor=(0.0, 0.72), fontsize=8)
    plain(axes)
    return drawn
