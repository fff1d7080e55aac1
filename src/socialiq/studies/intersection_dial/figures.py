"""The dial in the intersection beside agents of one angle each, drawn from the study's tables."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.experiments.tables import matching
from socialiq.plotting.rows import band
from socialiq.plotting.style import figure, plain

_LOOKS = {"dial": ("#2166ac", "o", "one dial"), "agents": ("#c23b22", "^", "an agent each")}
_RATES = {"arrival": "#1b7837", "collision": "#c23b22", "timeout": "#6e6e6e"}


def draw(results: Results) -> dict[str, Figure]:
    """All figures of the study."""
    return {
        "tradeoff": _tradeoff(results),
        "regret": _regret(results),
        "turning": _turning(results),
        "learning": _learning(results),
    }


def _tradeoff(results: Results) -> Figure:
    """Mean totals of every policy; a dial's are joined in the order in which it turns."""
    drawn = figure(7.5, 5.2)
    axes = drawn.subplots()
    for family, (color, mark, label) in _LOOKS.items():
        for place, seed in enumerate(results.config["seeds"]):
            rows = matching(results.tables["policies"], family=family, seed=seed)
            axes.plot(
                [row["r_env"] for row in rows],
                [row["r_social"] for row in rows],
                marker=mark,
                linestyle="-" if family == "dial" else "none",
                linewidth=0.6,
                markersize=5,
                color=color,
                alpha=0.6,
                label=label if place == 0 else None,
            )
    axes.set(xlabel="mean total r_env of an episode", ylabel="mean total r_social of an episode")
    axes.set_title("Turning from 0° (right) to 90° (left), all seeds", fontsize=10)
    axes.legend(frameon=False, fontsize=9)
    plain(axes)
    return drawn


def _regret(results: Results) -> Figure:
    """Regret against the best policy of all at each key angle."""
    drawn = figure(7.0, 4.2)
    axes = drawn.subplots()
    for family, (color, mark, label) in _LOOKS.items():
        rows = matching(results.tables["policies"], family=family)
        band(axes, rows, "asked", "regret", color=color, marker=mark, label=label)
    axes.set(xlabel="angle asked for, degrees", ylabel="regret against the best of all")
    axes.set_title("Mean over seeds, band from least to largest", fontsize=10)
    axes.legend(frameon=False, fontsize=9)
    plain(axes)
    return drawn


def _turning(results: Results) -> Figure:
    """Endings of the dial's episodes at each angle."""
    drawn = figure(7.0, 4.2)
    axes = drawn.subplots()
    rows = matching(results.tables["policies"], family="dial")
    for name, color in _RATES.items():
        band(axes, rows, "asked", name, 100.0, color=color, marker="o", label=name)
    axes.set(xlabel="angle asked for, degrees", ylabel="episodes, %", ylim=(0, 100))
    axes.set_title("One dial, turned: mean over seeds, band from least to largest", fontsize=10)
    axes.legend(frameon=False, fontsize=9)
    plain(axes)
    return drawn


def _learning(results: Results) -> Figure:
    """J(α) of each run while it trains: mean over the angles at which it is looked at."""
    drawn = figure(8.0, 4.2)
    axes = drawn.subplots()
    curves = results.tables["curves"]
    for name in dict.fromkeys(row["run"] for row in curves):
        rows = [row for row in curves if row["run"] == name]
        family = "dial" if name.startswith("dials") else "agents"
        updates, totals = ([row[key] for row in rows] for key in ("updates", "total"))
        axes.plot(updates, totals, color=_LOOKS[family][0], linewidth=0.9, alpha=0.6)
    axes.set(xlabel="updates", ylabel="J(α): a dial's mean over 0°, 45°, 90°")
    axes.set_title("Blue: dials. Red: agents, each at its own angle", fontsize=10)
    plain(axes)
    return drawn
