"""Figures of the ablations of the intersection study, one for each part beside main."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.learners.iq_learn.presets import INTERSECTION_STRENGTH
from socialiq.plotting.style import COLORS, MARKS, figure, finish, head
from socialiq.social.angle import angle_of
from socialiq.types import Row
from socialiq_lab.intersection.plots import (
    OUTCOME_COLORS,
    Runs,
    dots,
    greedy_runs,
    percent,
    seeds_and_episodes,
)
from socialiq_lab.results import Results

PER_EPISODE = 15  # transitions of an episode, about; it places a mixture of equal trajectories


def _line(
    axes: Any,
    name: str,
    points: Mapping[float, Sequence[Row]],
    values: Callable[[Sequence[Row]], float],
    **changes: Any,
) -> None:
    """Draw a policy's line through the value of all rows at each x, and a dot for each row."""
    xs = sorted(points)
    style = {"color": COLORS[name], "marker": MARKS[name], "label": name, "markersize": 6}
    axes.plot(xs, [values(points[x]) for x in xs], **(style | changes))
    dots = [(x, values([row])) for x in xs for row in points[x]]
    axes.plot(*zip(*dots, strict=True), ".", color=COLORS[name], alpha=0.35)


def _mean_percent(metric: str) -> Callable[[Sequence[Row]], float]:
    """Return a function that gives the mean of a share over rows, in percent."""
    return lambda rows: float(np.mean(percent(rows, metric)))


def strengths(results: Results) -> Figure:
    """Draw angle, arrivals and timeouts of each target against λ."""
    every = greedy_runs(results, "strengths")
    drawn = figure(9.1, 3.6)
    panels = drawn.subplots(1, 3)
    values = (_mean_angle, _mean_percent("arrival"), _mean_percent("timeout"))
    labels = ("empirical angle (degrees)", "arrivals (% of episodes)", "timeouts (% of episodes)")
    ticks = sorted({float(parts[0]) for parts, _ in every})
    for axes, value, label in zip(panels, values, labels, strict=True):
        for target in list(COLORS)[1:]:
            points = _by_first([(parts, row) for parts, row in every if parts[1] == target])
            _line(axes, target, points, value)
        axes.axvline(INTERSECTION_STRENGTH, color="#999999", linestyle=":", linewidth=1)
        axes.set_xscale("log")
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
        finish(axes, xlabel="λ", ylabel=label)
    for axes in panels[1:]:
        axes.set_ylim(-4, 104)
    title = f"Intersection: regularization strength; {seeds_and_episodes(every)}"
    head(drawn, f"{title} (dotted: λ of the preset)", panels[0])
    return drawn


def _by_first(every: Runs) -> dict[float, list[Row]]:
    points: dict[float, list[Row]] = {}
    for parts, row in every:
        points.setdefault(float(parts[0]), []).append(row)
    return points


def _mean_angle(rows: Sequence[Row]) -> float:
    """Return the angle of mean totals between -90 and 270, a cut that no policy crosses."""
    env = float(np.mean([row["r_env"] for row in rows]))
    return (angle_of(env, float(np.mean([row["r_social"] for row in rows]))) + 90) % 360 - 90


def targets(results: Results) -> Figure:
    """Draw arrivals and timeouts by temperature, kind of target and value of the ending."""
    every = greedy_runs(results, "targets")
    endings = list(dict.fromkeys(parts[2] for parts, _ in every))
    kinds = {
        target: list(dict.fromkeys(parts[0] for parts, _ in every if parts[3] == target))
        for target in COLORS
    }
    drawn = figure(9.1, 2.7 * len(endings) + 0.6)
    widths = [max(len(kinds[target]), 1) for target in COLORS]
    grid = drawn.subplots(
        len(endings), len(COLORS), squeeze=False, sharex="col", sharey=True, width_ratios=widths
    )
    images = []
    for panels, ending in zip(grid, endings, strict=True):
        for axes, target in zip(panels, COLORS, strict=True):
            here = [(p, row) for p, row in every if p[2:4] == [ending, target]]
            images.append(_cells(axes, here, kinds[target], target == "baseline"))
        panels[0].set_ylabel(f"ending: {ending}\n\ntemperature")
    for axes, target in zip(grid[0], COLORS, strict=True):
        axes.set_title(target, fontsize=10)
    drawn.colorbar(images[0], ax=grid, label="arrivals (% of episodes)", shrink=0.8, pad=0.01)
    title = "Intersection: kinds of target; colour: arrivals, number: timeouts in % of episodes"
    head(drawn, f"{title}\n{seeds_and_episodes(every)}")
    return drawn


def _cells(axes: Any, every: Runs, kinds: list[str], no_prior: bool) -> Any:
    """Draw a grid with a row for each temperature and a column for each kind of target."""
    temperatures = sorted({float(parts[1]) for parts, _ in every}, reverse=True)
    picture = np.full((len(temperatures), len(kinds)), np.nan)
    for parts, row in every:
        place = temperatures.index(float(parts[1])), kinds.index(parts[0])
        picture[place] = 100 * row["arrival"]
        color = "white" if row["arrival"] < 0.6 else "black"
        text = f"{100 * row['timeout']:.0f}"
        axes.text(*place[::-1], text, ha="center", va="center", color=color, fontsize=9)
    names = ["no prior"] if no_prior else kinds
    axes.set_xticks(range(len(kinds)), names, rotation=35, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(temperatures)), [f"{one:g}" for one in temperatures])
    axes.tick_params(length=0, labelsize=9)
    return axes.imshow(picture, vmin=0, vmax=100, cmap="viridis", aspect="auto")


def views(results: Results) -> Figure:
    """Draw the egoist's collisions and arrivals by the view of its network."""
    every = greedy_runs(results, "views")
    drawn = dots(every, 3.6)
    steps = results.config["view_steps"]
    title = f"Intersection: the egoist by view, trained for {steps:,} steps"
    head(drawn, f"{title}\n{seeds_and_episodes(every)} (dot: a seed, bar: mean)")
    return drawn


def data(results: Results) -> Figure:
    """Draw the endings of each policy against the demonstrated transitions of each mode."""
    every = greedy_runs(results, "data")
    drawn = figure(9.1, 3.8)
    panels = drawn.subplots(1, 3)
    sizes = {int(parts[1]) for parts, _ in every if parts[0] == "equal_transitions"}
    for axes, metric in zip(panels, OUTCOME_COLORS, strict=True):
        for target in COLORS:
            here = [(parts, row) for parts, row in every if parts[2] == target]
            _mixtures(axes, target, here, _mean_percent(metric))
        axes.set_xscale("log")
        axes.set_xticks(sorted(sizes), [f"{size:,}" for size in sorted(sizes)])
        axes.minorticks_off()
        axes.set_ylim(*((0, None) if metric == "collision" else (-4, 104)))
        finish(axes, xlabel="transitions of each mode", ylabel=f"{metric}s (% of episodes)")
    title = f"Intersection: amount of demonstrations; {seeds_and_episodes(every)}"
    note = f"open marks: as many episodes of each mode, at {PER_EPISODE} times their number"
    head(drawn, f"{title}\n{note}", panels[0], columns=4)
    return drawn


def _mixtures(axes: Any, target: str, every: Runs, value: Callable[[Sequence[Row]], float]) -> None:
    """Draw filled marks on a line for equal transitions, open ones for equal trajectories."""
    transitions: dict[float, list[Row]] = {}
    trajectories: dict[float, list[Row]] = {}
    for (mixture, size, *_), row in every:
        if mixture == "equal_transitions":
            transitions.setdefault(float(size), []).append(row)
        else:
            trajectories.setdefault(float(size) * PER_EPISODE, []).append(row)
    if transitions:
        _line(axes, target, transitions, value)
    if trajectories:
        shape = {"linestyle": "none", "markerfacecolor": "white", "markersize": 10, "zorder": 1.9}
        _line(axes, target, trajectories, value, **shape, label=None)


ABLATIONS = {
    "views": views,
    "strengths": strengths,
    "targets": targets,
    "data": data,
}
"""The figure of each part whose policies have a stage of its name."""
