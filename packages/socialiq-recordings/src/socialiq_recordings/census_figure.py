"""Figure of a census: drivers in the plane of the rewards, and their angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, figure, plain
from socialiq_recordings.census import STANDING

_ENDINGS = {
    "truncated": ("o", COLORS["prosocial"], "left the view"),
    "arrival": ("^", COLORS["altruistic"], "arrived"),
    "collision": ("X", COLORS["egoistic"], "collided"),
}


def census(
    drivers: Sequence[Mapping[str, Any]],
    population: Mapping[str, Any],
    posterior: Sequence[Mapping[str, Any]],
) -> Figure:
    """Draw the points, the angles, and the posterior of the angles.

    Args:
        drivers: Rows of `drivers.csv`.
        population: `population` of `summary.json`.
        posterior: Rows of `posterior.csv`; may be empty.
    """
    drawn = figure(14.5, 4.8)
    left, middle, right = drawn.subplots(1, 3, width_ratios=(1.25, 1.0, 1.0))
    _points(left, drivers, population)
    _angles(middle, drivers)
    _posterior(right, posterior)
    return drawn


def _points(axes: Any, drivers: Sequence[Mapping[str, Any]], population: Mapping[str, Any]) -> None:
    plain(axes)
    axes.axhline(0.0, color="#aaaaaa", linewidth=0.8)
    axes.axvline(0.0, color="#aaaaaa", linewidth=0.8)
    for ending, (mark, color, label) in _ENDINGS.items():
        for standing in (False, True):
            group = [
                one
                for one in drivers
                if one["ending"] == ending and (one["speed"] < STANDING) == standing
            ]
            if group:
                axes.scatter(
                    [one["r_env"] for one in group],
                    [one["r_social"] for one in group],
                    s=[8.0 + 6.0 * one["decisions"] for one in group],
                    marker=mark,
                    facecolors="none" if standing else color,
                    edgecolors=color,
                    alpha=0.6,
                    linewidths=0.9,
                    label=f"{label}{', stood all the time' if standing else ''} ({len(group)})",
                )
    env, social = population["r_env"], population["r_social"]
    axes.annotate(
        "",
        xy=(env, social),
        xytext=(0.0, 0.0),
        arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.6},
    )
    interval = population["over_chains"] or population["over_drivers"]
    unit = "chains" if population["over_chains"] else "drivers"
    share = f"{100 * population['confidence']:g} %"
    axes.plot(
        [],
        [],
        color="black",
        label=f"mean: {interval['estimate']:.0f}° ({share} over {unit}: "
        f"{interval['low']:.0f}° to {interval['high']:.0f}°)",
    )
    moving = population["of_the_moving"]
    if moving is not None and population["standing"]:
        axes.plot([], [], " ", label=f"without those who stood: {moving['estimate']:.0f}°")
    axes.set_xlabel("mean r_env of a decision")
    axes.set_ylabel("mean r_social of a decision")
    axes.set_title(
        f"{population['vehicles']} vehicles of {population['chains']} chains of recordings "
        "(larger: more decisions)",
        fontsize=10,
    )
    axes.legend(loc="best", fontsize=8)


def _angles(axes: Any, drivers: Sequence[Mapping[str, Any]]) -> None:
    plain(axes)
    known = sorted(
        (one for one in drivers if one["angle"] is not None), key=lambda one: one["angle"]
    )
    for height, one in enumerate(known):
        if one["low"] is not None:
            axes.plot([one["low"], one["high"]], [height, height], color="#9db8d9", linewidth=1.0)
    sure = np.array([one["low"] is not None for one in known], bool)
    angle, height = np.array([one["angle"] for one in known]), np.arange(len(known))
    axes.plot(
        angle[~sure],
        height[~sure],
        ".",
        color="#b5b5b5",
        markersize=4,
        label=f"no interval ({int((~sure).sum())})",
    )
    axes.plot(
        angle[sure],
        height[sure],
        ".",
        color=COLORS["prosocial"],
        markersize=5,
        label=f"with interval ({int(sure.sum())})",
    )
    axes.set_xlabel("direction of the driver's point, degrees")
    axes.set_ylabel("drivers, by angle")
    axes.set_title("Angles of single drivers, with the intervals that exist", fontsize=10)
    axes.legend(loc="upper left", fontsize=8)


def _posterior(axes: Any, posterior: Sequence[Mapping[str, Any]]) -> None:
    plain(axes)
    ends = [one["low"] for one in posterior] + [one["high"] for one in posterior[-1:]]
    for name, color, label in (
        ("share", "#b5b5b5", "all"),
        ("share_moving", COLORS["prosocial"], "without those who stood"),
    ):
        shares = np.array([100 * one[name] for one in posterior])
        if len(shares) and np.isfinite(shares).all():
            axes.stairs(shares, ends, color=color, linewidth=1.8, label=label)
            axes.legend(loc="upper left", fontsize=8)
    axes.margins(y=0.2)  # space for the legend
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("angle shown, degrees")
    axes.set_ylabel("posterior, % in 15 degrees")
    axes.set_title("Which angles the drivers may show", fontsize=10)
