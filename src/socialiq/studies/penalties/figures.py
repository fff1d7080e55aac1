"""Deviation from the prior and regret at the target, by penalty."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import figure, plain

_COLORS = ("#2166ac", "#c23b22", "#e08214")


def draw(results: Results) -> dict[str, Figure]:
    """Draw the mean deviation and the mean regret over target angles, by λ."""
    drawn = figure(8.4, 3.8)
    left, right = drawn.subplots(1, 2, sharex=True)
    gaps, regrets = results.tables["deviations"], results.tables["pooled"]
    regrets = [row for row in regrets if row["readout"] == "soft"]
    names = list(dict.fromkeys(row["penalty"] for row in gaps))
    for axes, rows, column in ((left, gaps, "matched"), (right, regrets, "regret")):
        strengths = sorted({row["strength"] for row in rows})
        for name, color in zip(names, _COLORS, strict=True):
            here = [row for row in rows if row["penalty"] == name]
            means = [
                np.mean([row[column] for row in here if row["strength"] == strength])
                for strength in strengths
            ]
            axes.plot(strengths, means, marker="o", color=color, label=name)
        axes.set_xticks(strengths)
        plain(axes)
    left.set(xlabel="λ", ylabel="share of transitions at λR(α)")
    right.set(xlabel="λ", ylabel="regret at the target, soft policy")
    left.legend(frameon=False, fontsize=8)
    return {"penalties": drawn}
