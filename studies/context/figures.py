"""Figures of the study."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.plotting.style import figure, finish
from socialiq_lab.results import Results
from socialiq_lab.tables import groups, matching
from studies.context.config import CANDIDATES, COMPARED, MAIN, RULES

_COLORS = ("#c23b22", "#2166ac", "#1b7837", "#762a83", "#b8860b")
_MARKS = "o^sDPvX<>"


def draw(results: Results) -> dict[str, Figure]:
    """Draw the trade-off, and the decision losses by context."""
    return {"tradeoff": _tradeoff(results), "contexts": _contexts(results)}


def _tradeoff(results: Results) -> Figure:
    """Draw the mean totals of the rules beside the curve of the constant angles."""
    drawn = figure(7.5, 5.0)
    axes = drawn.subplots()
    constants = matching(results.tables["drivers"], kind="constant")
    pairs = [(row["r_env"], row["r_social"]) for row in constants]
    axes.plot(*zip(*pairs, strict=True), "-o", color="#6e6e6e", markersize=4, label="constant")
    for row, pair in zip(constants, pairs, strict=True):
        if float(row["driver"]) % 15 == 0:
            axes.annotate(f"{row['driver']}°", pair, (6, 4), textcoords="offset points", fontsize=8)
    for number, name in enumerate(RULES):
        (row,) = matching(results.tables["drivers"], driver=name)
        color = _COLORS[number % len(_COLORS)]
        point = ([row["r_env"]], [row["r_social"]])
        axes.plot(*point, linestyle="none", marker=_MARKS[number], color=color, label=name)
    # Beyond 70 degrees the dial waits, and no rule of the study comes near.
    rows = [matching(results.tables["drivers"], driver=name)[0] for name in RULES]
    low = min(row["r_env"] for row in rows) - 0.5
    labels = {"xlabel": "mean total r_env", "ylabel": "mean total r_social", "xlim": (low, None)}
    top = 0.3 + max(social for env, social in pairs if env >= low)
    labels["ylim"] = (min(social for _, social in pairs) - 0.1, top)
    finish(axes, "One dial: constant angles, and angles that follow a rule", 8, **labels)
    return drawn


def _contexts(results: Results) -> Figure:
    """Draw the decision loss of some drivers at each angle, a panel for each context."""
    drawn = figure(8.5, 3.6)
    contexts = groups(results.tables["losses"], "context")
    panels = drawn.subplots(1, len(contexts), sharey=True)
    for axes, ((context,), rows) in zip(panels, contexts.items(), strict=True):
        for row, color in zip(rows, _COLORS, strict=False):
            values = [row[f"at_{angle:g}"] for angle in CANDIDATES]
            name = "the rule" if row["driver"] == MAIN else f"constant {row['driver']}°"
            axes.plot(CANDIDATES, values, "-o", color=color, markersize=4, label=name)
        axes.axvline(float(rows[0]["declared_angle"]), color="#6e6e6e", linestyle=":")
        labels = {"xlabel": "angle, degrees", "ylabel": "decision loss, reward an episode"}
        finish(axes, f"{context}; dotted: declared", 8, **labels, xticks=CANDIDATES)
    assert len(COMPARED) < len(_COLORS)
    return drawn
