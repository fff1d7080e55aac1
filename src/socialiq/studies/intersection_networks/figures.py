"""The egoists of both networks against what a good one should reach, and how they learned."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from socialiq.experiments.intersection.plots import (
    by_run,
    curve,
    described,
    dots,
    runs,
    with_target,
)
from socialiq.experiments.results import Results
from socialiq.plotting.style import COLORS, figure, plain
from socialiq.studies.intersection_networks.study import NETWORKS

FORESIGHT = {"experts": "", "foresight": ", one look ahead"}
"""Stages, and what their rows are called beside the network."""


def draw(results: Results) -> dict[str, Figure]:
    """All figures of the study."""
    return {"egoists": egoists(results), "learning": learning(results)}


def egoists(results: Results) -> Figure:
    """Collisions and arrivals of every seed, with and without a look at the true future."""
    every = [
        ([f"{parts[0]}{suffix}", *parts[1:]], row)
        for stage, suffix in FORESIGHT.items()
        for parts, row in runs(results, stage)
        if parts[1] == "egoistic"
    ]
    drawn, panels = dots(every, 3.0)
    with_target(panels, results.summary["target"])
    title = "Intersection: the egoist by network (dashed: what a good one should reach)"
    drawn.suptitle(f"{title}\n{described(every)} (dot: a seed, bar: mean)", fontsize=10)
    return drawn


def learning(results: Results) -> Figure:
    """Value at the own angle by updates: the mean over seeds, and their range."""
    drawn = figure(9.1, 3.4)
    curves = by_run(results)
    for axes, network in zip(drawn.subplots(1, 2, sharey=True), NETWORKS, strict=True):
        for mode in list(COLORS)[1:]:
            found = [one for run, one in curves.items() if f"experts/{network}/{mode}/" in run]
            curve(axes, mode, found, "-")
        axes.set_title(f"experts with the {network} network", fontsize=10)
        axes.set(xlabel="updates")
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.xaxis.set_major_formatter(lambda updates, _: f"{updates:,.0f}")
        plain(axes)
    drawn.axes[0].set_ylabel("value at the own angle (reward)")
    handles, labels = drawn.axes[1].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncols=3)
    seeds = len(results.config["seeds"])
    title = f"Intersection: learning curves; egoist: mean and range of {seeds} seeds"
    drawn.suptitle(title, fontsize=10)
    return drawn
