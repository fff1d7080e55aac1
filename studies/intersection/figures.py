"""Figures of the main part: Figs 6.5 and A.1, Table 6.2, endings, learning curves, exposure.

The trade-off and the ablations have files of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from socialiq.plotting.style import COLORS, MARKS, Mark, figure, finish, head, plain, ring
from socialiq.social.angle import angle_difference
from socialiq.types import Row
from socialiq_lab.intersection import thesis_values
from socialiq_lab.intersection.fitting import Checks
from socialiq_lab.intersection.plots import (
    greedy_runs,
    learning_panel,
    percent,
    stacked_outcomes,
)
from socialiq_lab.results import Results
from socialiq_lab.tables import matching
from studies.intersection.figures_ablations import ABLATIONS
from studies.intersection.figures_tradeoff import GROUPS, tradeoff
from studies.intersection.plan import SHIPPED

METRICS = {
    "collision": "collisions (%)",
    "arrival": "arrivals (%)",
    "timeout": "timeouts (%)",
    "speed_kmh": "mean speed (km/h)",
    "stopped": "time stopped (%)",
}
SIGNALS = {
    "r_self": "classical: r_self (own)",
    "r_global": "classical: r_global (others)",
    "r_env": "ego-centric: r_env (own progress)",
    "r_social": "ego-centric: r_social (effect on others)",
}
EXPOSURES = {
    "at_fault_per_episode": "per 100 episodes",
    "at_fault_per_entry": "per 100 entries into the junction",
    "at_fault_per_conflict": "per 100 decisions in conflict",
}
LINES = {"egoistic": "-", "prosocial": "--", "altruistic": "-."}


def draw(results: Results) -> dict[str, Figure]:
    """Draw all figures of the intersection study; one of a part that was not run is left out."""
    found = {
        "fig_6_5_ring": fig_6_5(results),
        "table_6_2": table_6_2(results),
        "presets": presets(results),
        "tradeoff": tradeoff(results),
        "fig_a_1": fig_a_1(results),
        "learning": learning(results),
        "exposure": exposure(results),
    }
    return found | {
        part: picture(results) for part, picture in ABLATIONS.items() if greedy_runs(results, part)
    }


def _counts(results: Results) -> str:
    """Return the number of training seeds and episodes, for a title."""
    seeds, episodes = len(results.config["seeds"]), results.config["episodes"]
    return f"greedy, {seeds} training seed{'s'[: seeds != 1]}, {episodes} episodes each"


def fig_6_5(results: Results) -> Figure:
    """Draw Fig 6.5: the empirical angle of each learner, the thesis' as an open mark outside."""
    marks = []
    for name in COLORS:
        angle = results.summary["policies"]["_".join((*SHIPPED, name))]["angle"]
        # Around the mean, because the least and greatest number may span the gap at 180 degrees.
        away = [angle_difference(row["angle"], angle) for row in _learners(results, name)]
        spread = (angle + min(*away, 0.0), angle + max(*away, 0.0))
        thesis = thesis_values.FIG_6_5.get(name)
        printed = "not printed" if thesis is None else f"{thesis:.0f}°"
        label = f"{name}: {angle:.0f}° ({spread[0]:.0f}° to {spread[1]:.0f}°; thesis {printed})"
        marks.append(Mark(name, angle, label, thesis, spread))
    note = "open marks: thesis; arcs: range over training seeds"
    return ring(marks, f"Intersection: empirical angle, {_counts(results)}\n({note})")


def _learners(results: Results, target: str, group: str = "/".join(SHIPPED)) -> list[Row]:
    return [row for parts, row in greedy_runs(results, f"learners/{group}") if parts[0] == target]


def table_6_2(results: Results) -> Figure:
    """Draw Tables 6.1 and 6.2: each metric of experts and learners, beside the thesis'."""
    rows = {
        (row["metric"], row["policy"]): row
        for row in matching(results.tables["table_6_2"], readout="greedy")
        if (row["preset"], row["setting"]) in (("experts", "flat"), SHIPPED)
    }
    drawn = figure(9.1, 4.6)
    panels = drawn.subplots(1, len(METRICS), sharey=True)
    # An expert and the learner of its mode are side by side.
    places = [1.5 * (number // 2) + 0.65 * (number % 2) for number in range(7)]
    for axes, (metric, label) in zip(panels, METRICS.items(), strict=True):
        for place, policy in zip(places, thesis_values.POLICIES, strict=True):
            if (metric, policy) in rows:
                _compared(axes, place, policy.removeprefix("expert "), rows[metric, policy])
        axes.set_xlabel(label)
        axes.set_xlim(-0.06 * axes.get_xlim()[1], axes.get_xlim()[1])
        axes.xaxis.set_major_locator(MaxNLocator(4))
        plain(axes)
    panels[0].set_yticks(places, thesis_values.POLICIES)
    panels[0].set_ylim(places[-1] + 0.5, -0.4)
    groups = results.config["group_episodes"]
    drawn.legend(handles=_table_legend(groups), loc="outside lower center", ncols=2, fontsize=9)
    shipped = ", ".join(SHIPPED)
    head(drawn, f"Tables 6.1 and 6.2: {shipped}, {_counts(results)}; one expert of each mode")
    return drawn


def _compared(axes: Any, place: float, name: str, row: Row) -> None:
    """Draw our value, and below it the thesis'."""
    color, ours, thesis = COLORS[name], row["ours"], row["thesis"]
    spread = np.array([-1, 1])
    wide = {"color": color, "alpha": 0.3, "linewidth": 7, "solid_capstyle": "butt"}
    axes.plot(ours + spread * row["over_evaluation"], [place - 0.12] * 2, **wide)
    if row["over_training"] != "":
        axes.plot(ours + spread * row["over_training"], [place - 0.12] * 2, "|-", color=color)
    axes.plot([ours], [place - 0.12], MARKS[name], color=color, markersize=6)
    around = thesis + spread * row["thesis_spread"]
    axes.plot(around, [place + 0.16] * 2, color=color, linewidth=1)
    hollow = {"markerfacecolor": "white", "markersize": 5.5}
    axes.plot([thesis], [place + 0.16], MARKS[name], color=color, **hollow)


def _table_legend(groups: int) -> list[Line2D]:
    grey: dict[str, Any] = {"color": "#444444"}
    return [
        Line2D([], [], marker="o", linestyle="none", **grey, label="ours, mean"),
        Line2D([], [], marker="o", markerfacecolor="white", linewidth=1, **grey,
               label="thesis, mean ± spread over 5 evaluation seeds"),
        Line2D([], [], marker="|", **grey, label="± sd over training seeds"),
        Line2D([], [], linewidth=7, alpha=0.3, solid_capstyle="butt", **grey,
               label=f"± sd over groups of {groups} evaluation episodes"),
    ]  # fmt: skip


def presets(results: Results) -> Figure:
    """Draw the endings of episodes in each group of learners."""
    drawn = figure(9.1, 2.9)
    panels = drawn.subplots(1, len(GROUPS), sharey=True)
    for axes, (group, (_, title)) in zip(panels, GROUPS.items(), strict=True):
        key = group.replace("/", "_")
        rows = {name: results.summary["policies"][f"{key}_{name}"] for name in COLORS}
        stacked_outcomes(axes, rows, 6.0)
        axes.set_title(title, fontsize=10)
    panels[0].invert_yaxis()
    head(drawn, f"Intersection: how episodes end, {_counts(results)}", panels[0])
    return drawn


def fig_a_1(results: Results) -> Figure:
    """Draw Fig A.1: rewards of a decision in the demonstrations, classical and ego-centric."""
    drawn = figure(9.1, 5.6)
    panels = drawn.subplots(2, 2, sharey=True)
    for axes, (signal, title) in zip(panels.ravel(), SIGNALS.items(), strict=True):
        for mode, line in LINES.items():
            bins = matching(results.tables["fig_a_1"], mode=mode, signal=signal)
            edges = [*(row["from"] for row in bins), bins[-1]["to"]]
            style = {"color": COLORS[mode], "linestyle": line, "linewidth": 1.4}
            axes.stairs(percent(bins, "share"), edges, baseline=None, label=mode, **style)
        finish(axes, title, yscale="log", xlabel="reward of a decision", ylim=(0.02, 130))
        axes.set_yticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
    for row in panels:
        row[0].set_ylabel("% of decisions")
    episodes = results.config["pool_episodes"]
    title = f"Fig A.1: rewards of the experts' demonstrations, {episodes} episodes of each mode"
    head(drawn, f"{title} (outermost bins: and beyond)", panels[0][0])
    return drawn


def learning(results: Results) -> Figure:
    """Draw learning curves: experts one by one, learners as means over training seeds."""
    drawn = figure(9.1, 6.6)
    panels = drawn.subplots(2, 2).ravel()
    label = "value at the own angle (reward)"
    learning_panel(panels[0], results, "experts/flat", [*LINES], "experts", ylabel=label)
    for axes, (group, (_, title)) in zip(panels[1:], GROUPS.items(), strict=True):
        title = f"{title}: mean and range of {len(results.config['seeds'])} seeds"
        learning_panel(axes, results, f"learners/{group}", [*COLORS], title, ylabel=label)
    title = f"Intersection: learning curves, {Checks().episodes} greedy episodes a check"
    head(drawn, title, panels[1], columns=4)
    return drawn


def exposure(results: Results) -> Figure:
    """Draw collisions at fault of learners and experts by exposure (thesis 7.2)."""
    drawn = figure(9.1, 3.8)
    panels = drawn.subplots(1, len(EXPOSURES))
    names = [*LINES, "baseline"]
    experts = {parts[0]: [row] for parts, row in greedy_runs(results, "experts/flat")}
    for axes, (rate, label) in zip(panels, EXPOSURES.items(), strict=True):
        for place, name in enumerate(names):
            _rates(axes, place - 0.2, name, experts.get(name, []), rate, 0.4)
            _rates(axes, place + 0.2, name, _learners(results, name), rate, 1.0)
        axes.set_xticks(range(len(names)), names, rotation=25)
        axes.set_ylim(bottom=0)
        finish(axes, label)
    panels[0].set_ylabel("collisions at fault")
    handles: list[Any] = [
        Patch(color="#555555", alpha=0.4, label="expert (line: 95 % interval)"),
        Patch(color="#555555", label=f"learners, {', '.join(SHIPPED)} (dot: a seed)"),
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=2)
    head(drawn, f"Intersection: collisions at fault by exposure, {_counts(results)}")
    return drawn


def _rates(
    axes: Any, place: float, name: str, rows: Sequence[Row], rate: str, alpha: float
) -> None:
    """Draw a bar at the mean over rows; a rate over nothing is empty, and left out."""
    kept = [row for row in rows if row[rate] != ""]
    values = percent(kept, rate)
    if rows and not kept:
        nothing = f" no {rate.rsplit('_')[-1]}"
        axes.text(place, 0, nothing, ha="center", va="bottom", rotation=90, fontsize=8)
    if not kept:
        return
    axes.bar([place], [np.mean(values)], 0.38, color=COLORS[name], alpha=alpha, linewidth=0)
    if len(values) > 1:
        spots = place + np.linspace(-0.1, 0.1, len(values))
        axes.plot(spots, values, ".", color="black", markersize=4, clip_on=False)
    if len(rows) == 1 and f"{rate}_low" in rows[0]:
        ends = [percent(kept, f"{rate}_{end}")[0] for end in ("low", "high")]
        axes.plot([place] * 2, ends, color="black", linewidth=1)
