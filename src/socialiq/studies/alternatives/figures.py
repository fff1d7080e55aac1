"""Regret against strength for each place where the prior can enter (appendix B)."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import figure, plain

_COLORS = ("#2166ac", "#888888", "#1b7837", "#e08214", "#c23b22")


def draw(results: Results) -> dict[str, Figure]:
    """One panel for each target angle; greedy full, soft dashed."""
    rows = results.tables["pooled"]
    angles = sorted({row["target_angle"] for row in rows})
    names = list(dict.fromkeys(row["integration"] for row in rows))
    drawn = figure(4.2 * len(angles), 4.2)
    panels = drawn.subplots(1, len(angles), sharex=True)
    for axes, angle in zip(panels, angles, strict=True):
        for name, color in zip(names, _COLORS, strict=True):
            for readout, line in (("greedy", "-"), ("soft", "--")):
                here = [
                    row
                    for row in rows
                    if (row["integration"], row["target_angle"], row["readout"])
                    == (name, angle, readout)
                ]
                axes.plot(
                    [row["strength"] for row in here],
                    [row["regret"] for row in here],
                    line,
                    marker=".",
                    color=color,
                    label=name if readout == "greedy" else None,
                )
        axes.set_xscale("log")
        axes.set(xlabel="λ (reweighting: 1/τ_w)", ylabel="regret at the target")
        axes.set_title(f"target {angle:g}° (full: greedy, dashed: soft)", fontsize=10)
        plain(axes)
    panels[0].legend(frameon=False, fontsize=8)
    return {"regret": drawn}
