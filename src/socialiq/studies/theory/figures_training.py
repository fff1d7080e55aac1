"""Figures of the theory's predictions beside trained networks."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from socialiq.plotting.style import figure, plain
from socialiq.types import Row

_COLORS = {"instantaneous": "#2166ac", "to_go": "#c23b22", "advantage": "#1b7837"}
_WAYS = {"online": "gradient through V(s')", "target": "slow copy"}
_PREDICTED = {
    "occupancy": ("occupancies, τ → 0", "D", "#bbbbbb", 0.3),
    "rows": ("rows, τ → 0", "s", "#e08214", 0.3),
    "solved": ("rows, solved at τ = 1", "P", "#6e6e6e", 0.42),
    "replay": ("rows and replay, solved at τ = 1", "*", "#000000", 0.24),
}


def training(tables: dict[str, list[Row]]) -> Figure:
    """For each gradient and target: the predicted λ, and each seed's interval of the grid."""
    firsts = tables["first_flips"]
    groups = list(dict.fromkeys((row["next_value"], row["target_kind"]) for row in firsts))
    drawn = figure(9.6, 1.4 + 0.85 * len(groups))
    axes = drawn.subplots()
    for place, (way, kind) in enumerate(groups):
        told = next(
            row
            for row in tables["predicted"]
            if (row["next_value"], row["target_kind"]) == (way, kind)
        )
        for name, (label, mark, color, above) in _PREDICTED.items():
            axes.plot(
                [told[name]],
                [place - above],
                mark,
                color=color,
                markersize=10 if mark == "*" else 6,
                label=label if place == 0 else None,
            )
        seeds = [row for row in firsts if (row["next_value"], row["target_kind"]) == (way, kind)]
        _intervals(axes, seeds, place, _COLORS[kind])
    axes.set_xscale("log")
    names = [f"{kind}\n{_WAYS[way]}" for way, kind in groups]
    axes.set_yticks(range(len(groups)), names)
    axes.invert_yaxis()
    axes.set(xlabel="λ of the first flip of the greedy policy")
    axes.set_title(
        "7x7, 0°, τ = 1: predicted (marks), and the grid's step in which each seed left (bars)",
        fontsize=10,
    )
    axes.legend(frameon=False, fontsize=8, loc="upper left")
    plain(axes)
    return drawn


def _intervals(axes: Any, seeds: list[Row], place: int, color: str) -> None:
    """A bar for each seed, from the last λ with the baseline's choices to the first without."""
    for number, row in enumerate(seeds):
        height = place + 0.5 * number / max(len(seeds) - 1, 1) - 0.1
        if row["first"] == "":
            continue
        below = row["below"] if row["below"] not in ("", 0.0) else row["first"] / 1.5
        axes.plot([below, row["first"]], [height] * 2, "|-", color=color, linewidth=2)


def lengths(tables: dict[str, list[Row]]) -> Figure:
    """Expected steps of an episode along λ, by target; exact, and trained networks at 0 degrees."""
    rows = tables["lengths"]
    angles = sorted({row["angle"] for row in rows})
    temperatures = sorted({row["temperature"] for row in rows}, reverse=True)
    drawn = figure(4.0 * len(angles), 4.2)
    panels = drawn.subplots(1, len(angles), sharey=True, squeeze=False)[0]
    for axes, angle in zip(panels, angles, strict=True):
        here = [row for row in rows if row["angle"] == angle]
        for kind in ("instantaneous", "to_go"):
            for temperature, line in zip(temperatures, ("-", "--"), strict=False):
                path = [
                    row
                    for row in here
                    if (row["target_kind"], row["temperature"]) == (kind, temperature)
                ]
                axes.plot(
                    [row["strength"] for row in path],
                    [row["soft_length"] for row in path],
                    line,
                    marker=".",
                    color=_COLORS[kind],
                    label=f"{kind}, τ = {temperature:g}",
                )
        axes.axhline(here[0]["optimum_length"], color="#6e6e6e", linestyle=":", label="optimum")
        if angle == 0.0:
            _trained(axes, tables["trained"])
        axes.set_xscale("symlog", linthresh=0.1, linscale=0.4)
        axes.set_xlim(-0.02, 1.25 * max(row["strength"] for row in here))
        axes.set_xticks([0, 0.1, 1, 10], ["0", "0.1", "1", "10"])
        axes.set(xlabel="λ", title=f"{angle:g}°")
        axes.title.set_fontsize(10)
        plain(axes)
    panels[0].set(ylabel="steps of an episode (soft policy)")
    panels[0].legend(frameon=False, fontsize=7)
    return drawn


def _trained(axes: Any, rows: list[Row]) -> None:
    """Means over seeds of networks with the gradient through V(s')."""
    for kind in ("instantaneous", "to_go"):
        here = [
            row
            for row in rows
            if (row["next_value"], row["target_kind"]) == ("online", kind)
            and row["prior_weight"] > 0.0
        ]
        strengths = sorted({row["strength"] for row in here})
        means = []
        for strength in strengths:
            group = [row["soft_length"] for row in here if row["strength"] == strength]
            means.append(sum(group) / len(group))
        axes.plot(strengths, means, "x", color=_COLORS[kind], label=f"{kind}, networks, τ = 1")
