"""Figures of the dial: regret by angle, path from 0 to 90 degrees, mixtures, budgets."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.plotting.style import band, figure, plain, spread
from socialiq_lab.results import Results
from socialiq_lab.tables import matching

_LOOKS = {
    "online": ("#2166ac", "o"),
    "online-short": ("#1b7837", "*"),
    "online-alone": ("#67a9cf", "s"),
    "online-clockless": ("#888888", "v"),
    "offline-redrawn": ("#e08214", "D"),
    "offline": ("#c23b22", "^"),
}
_CEILINGS = {"timed": "offline", "any time": "offline-redrawn"}


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw all figures of the study."""
    return {
        "regret": _regret_figure(results),
        "turning": _path_figure(results),
        "mixtures": _mixture_figure(results),
    } | ({"budgets": _budget_figure(results)} if "budget_path" in results.tables else {})


def _runs(results: Results) -> list[str]:
    return [name for name in _LOOKS if matching(results.tables["dials"], run=name)]


def _regret_figure(results: Results) -> Figure:
    """Greedy regret at each angle, with the ceilings of the demonstrations' support."""
    drawn = figure(8.0, 4.4)
    axes = drawn.subplots()
    for name in _runs(results):
        color, mark = _LOOKS[name]
        rows = matching(results.tables["angles"], run=name, readout="greedy")
        band(axes, rows, "angle", "regret", color=color, marker=mark, label=name)
    for support, name in _CEILINGS.items():
        rows = matching(results.tables.get("ceilings", []), support=support)
        if rows:
            angles, mean, _, _ = spread(rows, "angle", "regret")
            color = _LOOKS[name][0]
            label = f"best inside the support of {name}"
            axes.plot(angles, mean, "--", color=color, linewidth=2.5, alpha=0.5, label=label)
    axes.set(xlabel="angle asked for, degrees", ylabel="regret J*(α) - J(α)")
    axes.set_title("One network for every angle: mean over seeds, band from least to largest")
    axes.legend(frameon=False, fontsize=8)
    plain(axes)
    return drawn


def _path_figure(results: Results) -> Figure:
    """Path of the dial in the plane of the two sums, beside the best of every angle."""
    drawn = figure(7.0, 5.0)
    axes = drawn.subplots()
    best = results.tables["front"]
    axes.plot(
        [row["r_env"] for row in best],
        [row["r_social"] for row in best],
        "-",
        color="black",
        linewidth=1.0,
        label="exact Pareto front",
    )
    for name in [run for run in _runs(results) if run in ("online", "online-short", "offline")]:
        color, mark = _LOOKS[name]
        rows = matching(results.tables["angles"], run=name, readout="greedy")
        axes.plot(
            [row["r_env"] for row in rows],
            [row["r_social"] for row in rows],
            mark,
            color=color,
            markersize=6,
            alpha=0.5,
            linestyle="none",
            label=f"{name}, every 5°, all seeds",
        )
    axes.set(xlabel="mean sum of r_env", ylabel="mean sum of r_social")
    axes.set_title("Turning the dial from 0° (right) to 90° (left)")
    axes.legend(frameon=False, fontsize=9, loc="lower left")
    plain(axes)
    return drawn


def _mixture_figure(results: Results) -> Figure:
    """Radius of the mixture at each behavioural angle, and the error of estimated mixtures."""
    drawn = figure(11.0, 4.2)
    left, right = drawn.subplots(1, 2)
    for name in _runs(results):
        color, mark = _LOOKS[name]
        rows = matching(results.tables["settings"], run=name)
        angles, mean, low, _ = spread(rows, "wanted", "share_of_radius")
        left.plot(angles, 100 * mean, color=color, marker=mark, markersize=4, label=name)
        left.plot(angles, 100 * low, ":", color=color)
        estimated = [row for row in rows if row["estimated_angle_error"] != ""]
        errors = [row | {"off": abs(row["estimated_angle_error"])} for row in estimated]
        if errors:
            angles, mean, _, high = spread(errors, "wanted", "off")
            right.plot(angles, mean, color=color, marker=mark, markersize=4, label=name)
            right.plot(angles, high, ":", color=color)
    left.axhline(98, color="#444444", linewidth=0.8)
    left.set(xlabel="behavioural angle wanted, degrees", ylabel="radius, % of the largest")
    left.set_title("Exact mixtures (dotted: worst seed; line: 98 %)", fontsize=10)
    right.set(xlabel="behavioural angle wanted, degrees", ylabel="angle error, degrees")
    episodes = results.config["rollouts"]
    right.set_title(f"Mixtures set from {episodes} episodes a policy (dotted: worst)", fontsize=10)
    left.legend(frameon=False, fontsize=8)
    for axes in (left, right):
        plain(axes)
    return drawn


def _budget_figure(results: Results) -> Figure:
    """The regret of each agent while its multiplier is found, and what the data make of it."""
    drawn = figure(10.0, 4.0)
    left, right = drawn.subplots(1, 2)
    budgets = sorted({row["budget"] for row in results.tables["budgets"]})
    for place, budget in enumerate(budgets):
        color = f"C{place}"
        for row in matching(results.tables["budgets"], budget=budget):
            path = matching(results.tables["budget_path"], budget=budget, seed=row["seed"])
            updates, regrets = ([look[key] for look in path] for key in ("updates", "regret"))
            left.plot(updates, regrets, color=color, linewidth=0.9, alpha=0.7)
            right.plot(row["regret_soft"], row["log_likelihood"], "o", color=color)
        left.axhline(budget, color=color, linestyle=":", label=f"ε = {budget:g}")
    left.set(xlabel="updates", ylabel="regret of the soft policy", yscale="log")
    left.set_title("Dual ascent: regret (lines) and budget (dotted)", fontsize=10)
    left.legend(frameon=False, fontsize=8)
    right.set(xlabel="regret of the soft policy", ylabel="mean log-likelihood of the data")
    right.set_title("What a looser budget leaves to the data", fontsize=10)
    for axes in (left, right):
        plain(axes)
    return drawn
