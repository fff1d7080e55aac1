"""Fig 6.1: the action sequences that each policy of the 5x5 world learned."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from socialiq.experiments.results import Results
from socialiq.plotting.style import COLORS, figure

_FILL = {"W": "#d9d9d9", "G": "#2166ac"}
_INK = {"W": "#333333", "G": "white"}


def draw(results: Results) -> dict[str, Figure]:
    """One row for each policy: the commonest sequence over seeds, and the thesis' below it."""
    drawn = figure(8.0, 4.2)
    axes = drawn.add_subplot()
    policies = results.summary["policies"]
    for row, (name, entry) in enumerate(policies.items()):
        y = -row * 1.5
        agreeing = f"{entry['commonest_seeds']} of {entry['seeds']} seeds"
        axes.text(-0.3, y, name, ha="right", va="bottom", color=COLORS[name], weight="bold")
        axes.text(-0.3, y - 0.05, agreeing, ha="right", va="top", fontsize=8, color="#555555")
        _chips(axes, entry["commonest"], y, 0.62)
        axes.text(9.3, y, f"thesis: {entry['thesis']}", va="center", fontsize=9, family="monospace")
    axes.set(xlim=(-2.6, 12.2), ylim=(-1.5 * len(policies) + 0.7, 0.8))
    axes.axis("off")
    axes.set_title("5x5: greedy actions after training on one mixed data set (W wait, G go)")
    return {"fig_6_1": drawn}


def _chips(axes, letters: str, y: float, height: float) -> None:
    shown = letters if len(letters) <= 9 else letters[:8] + "…"
    for x, letter in enumerate(shown):
        fill = _FILL.get(letter, "white")
        axes.add_patch(Rectangle((x, y - height / 2), 0.9, height, facecolor=fill))
        axes.text(x + 0.45, y, letter, ha="center", va="center", color=_INK.get(letter, "#333333"))
