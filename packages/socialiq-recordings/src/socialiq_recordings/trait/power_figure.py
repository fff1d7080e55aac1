"""Figure of the power: shares of detections over the number of drivers."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, figure, finish
from socialiq.types import Row
from socialiq_recordings.trait.power import POWER


def power(rows: Sequence[Row]) -> Figure:
    """Draw the share of detections and the gain over the number of drivers, by population.

    Args:
        rows: Rows of `power.csv`.
    """
    drawn = figure(10.0, 4.0)
    left, right = drawn.subplots(1, 2)
    names = list(dict.fromkeys(row["population"] for row in rows))
    colors = list(COLORS.values())
    for number, name in enumerate(names):
        mine = [row for row in rows if row["population"] == name]
        drivers = [row["drivers"] for row in mine]
        share = [row["detected"] for row in mine]
        ends = [
            [max(0.0, row["detected"] - row["low"]) for row in mine],
            [max(0.0, row["high"] - row["detected"]) for row in mine],
        ]
        color = colors[number % len(colors)]
        shifted = [one * 1.03**number for one in drivers]
        left.errorbar(shifted, share, ends, fmt="o-", color=color, markersize=4, label=name)
        gain = [100 * row["rmse_gain"] for row in mine]
        right.plot(drivers, gain, "o-", color=color, markersize=4, label=name)
        right.axhline(100 * mine[0]["known_angle_gain"], color=color, linewidth=0.8, linestyle=":")
    left.axhline(POWER, color="#777777", linewidth=0.8)
    for axes in (left, right):
        axes.set_xscale("log")
    finish(left, "Angle found (95 % of the share)", 8, xlabel="drivers", ylabel="share of tries")
    left.set_ylim(-0.02, 1.02)
    finish(
        right,
        "RMSE saved by inferred angles (dotted: by known ones)",
        xlabel="drivers",
        ylabel="%",
    )
    return drawn
