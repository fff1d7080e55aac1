"""Figure of a prediction: what each model gains over the better trivial one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, figure, finish, head
from socialiq.types import Row
from socialiq_recordings.prediction.models import TRIVIAL

_SHOWN = (
    ("moving", COLORS["prosocial"], "o", "moving vehicles"),
    ("conflict", COLORS["egoistic"], "D", "moving vehicles in a conflict within 5 s"),
)
_PART = "second half"
_FARTHEST = 1.5  # nats; intervals beyond are cut
_FEWEST = 10  # moments; scores of fewer are not drawn


def gains(rows: Sequence[Row]) -> Figure:
    """Draw the gain of each model with its interval, a panel for each holdout.

    Args:
        rows: Rows of `scores.csv`.
    """
    holdouts = list(dict.fromkeys(row["holdout"] for row in rows))
    models = [m for m in dict.fromkeys(row["model"] for row in rows) if m not in TRIVIAL]
    drawn = figure(3.0 + 3.6 * len(holdouts), 1.8 + 0.33 * max(len(models), 1))
    panels = drawn.subplots(1, len(holdouts), sharey=True, squeeze=False)[0]
    for axes, holdout in zip(panels, holdouts, strict=True):
        of_holdout = [r for r in rows if r["holdout"] == holdout and r["part"] == _PART]
        _panel(axes, of_holdout, models)
        finish(axes, f"held-out {holdout}", xlabel="log-likelihood gained, nats a moment")
    panels[0].set_yticks(np.arange(len(models)), models, fontsize=8)
    panels[0].invert_yaxis()
    title = "Next second's acceleration against the better of constant speed and last acceleration"
    head(drawn, f"{title}; 95 % by chain", panels[0], columns=2)
    return drawn


def _panel(axes: Any, rows: Sequence[Row], models: Sequence[str]) -> None:
    axes.axvline(0.0, color="#777777", linewidth=0.8)
    for place, (subset, color, mark, label) in enumerate(_SHOWN):
        chosen = {
            row["model"]: row for row in rows if row["moments"] == subset and row["n"] >= _FEWEST
        }
        found = [(models.index(name), row) for name, row in chosen.items() if name in models]
        if not found:
            axes.plot([], [], mark, color=color, markersize=4, label=label)  # in the legend
            continue
        at = np.array([number for number, _ in found]) + (place - 0.5) * 0.3
        gain, low, high = (
            np.array([row[name] for _, row in found], np.float64)  # None becomes NaN
            for name in ("gain", "gain_low", "gain_high")
        )
        gain, low, high = (np.clip(one, -_FARTHEST, _FARTHEST) for one in (gain, low, high))
        axes.hlines(at, low, high, color=color, linewidth=1.2)
        axes.plot(gain, at, mark, color=color, markersize=4, label=label)
