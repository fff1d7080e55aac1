"""Figures of the study."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from socialiq.plotting.style import band, figure, finish, line
from socialiq_lab.results import Results
from socialiq_lab.tables import groups, matching
from studies.intersection_dial.config import (
    AGENTS,
    CALIBRATED,
    DIALS,
    ITERATED,
    PLANNED,
    TIMED,
)

_LOOKS = {
    DIALS: ("#2166ac", "o", "one dial"),
    AGENTS: ("#c23b22", "^", "an agent each"),
    TIMED: ("#1b7837", "s", "one dial with a clock"),
    CALIBRATED: ("#762a83", "D", "the same, with settings"),
    ITERATED: ("#d6604d", "P", "the same, improved by policy iteration"),
    PLANNED: ("#b8860b", "v", "the same, with online planning"),
}
_RATES = {"arrival": "#1b7837", "collision": "#c23b22", "timeout": "#6e6e6e"}


def _looks(results: Results) -> dict[str, tuple[str, str, str]]:
    """Return the looks of the families that there are; ablations have their tables alone."""
    there = {row["family"] for row in results.tables["policies"]}
    return {family: look for family, look in _LOOKS.items() if family in there}


def draw(results: Results) -> dict[str, Figure]:
    """Draw all figures of the study."""
    return {
        "tradeoff": _tradeoff(results),
        "regret": _regret(results),
        "turning": _turning(results),
        "learning": _learning(results),
    }


def _tradeoff(results: Results) -> Figure:
    """Draw mean totals of every policy; a dial's are joined in the order in which it turns."""
    drawn = figure(7.5, 5.2)
    axes = drawn.subplots()
    for family, (color, mark, label) in _looks(results).items():
        style: dict[str, Any] = {"linestyle": "none" if family == AGENTS else "-"}
        style |= {"marker": mark, "color": color, "linewidth": 0.6, "markersize": 5, "alpha": 0.6}
        for number, seed in enumerate(results.config["seeds"]):
            rows = matching(results.tables["policies"], family=family, seed=seed)
            if not rows:
                continue
            named = label if number == 0 else None
            line(axes, rows, "r_env", "r_social", **style, label=named)
    labels = {"xlabel": "mean total r_env of an episode"}
    labels["ylabel"] = "mean total r_social of an episode"
    finish(axes, "Turning from 0° (right) to 90° (left), all seeds", 9, **labels)
    return drawn


def _regret(results: Results) -> Figure:
    """Draw regret against the best policy of all at each key angle."""
    drawn = figure(7.0, 4.2)
    axes = drawn.subplots()
    for family, (color, mark, label) in _looks(results).items():
        rows = matching(results.tables["policies"], family=family)
        band(axes, rows, "asked", "regret", color=color, marker=mark, label=label)
    labels = {"xlabel": "angle asked for, degrees", "ylabel": "regret against the best of all"}
    finish(axes, "Mean over seeds, band from least to largest", 9, **labels)
    return drawn


def _turning(results: Results) -> Figure:
    """Draw the endings of the dial's episodes at each angle."""
    drawn = figure(7.0, 4.2)
    axes = drawn.subplots()
    there = _looks(results)
    shown = next((one for one in (ITERATED, CALIBRATED, TIMED, DIALS) if one in there), AGENTS)
    rows = matching(results.tables["policies"], family=shown)
    for name, color in _RATES.items():
        band(axes, rows, "asked", name, 100.0, color=color, marker="o", label=name)
    title = "One dial, turned: mean over seeds, band from least to largest"
    labels = {"xlabel": "angle asked for, degrees", "ylabel": "episodes, %"}
    finish(axes, title, 9, **labels, ylim=(0, 100))
    return drawn


def _learning(results: Results) -> Figure:
    """Draw J(α) of each run while it trains: the mean over the angles of its checks."""
    drawn = figure(8.0, 4.2)
    axes = drawn.subplots()
    for (run,), rows in groups(results.tables["curves"], "run").items():
        family = run.partition("/")[0].replace("dials", DIALS)
        color, *_ = _LOOKS.get(family, ("#999999",))
        line(axes, rows, "updates", "total", color=color, linewidth=0.9, alpha=0.6)
    title = "Blue: dials. Red: agents, each at its own angle. Green: with a clock. Grey: ablations"
    finish(axes, title, xlabel="updates", ylabel="J(α): a dial's mean over 0°, 45°, 90°")
    return drawn
