"""Figures of the thesis of any policies: maps of where they stop (6.4), adaptation over λ (D.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from socialiq.plotting import style
from socialiq.plotting.figures import colors_of, draw
from socialiq.results_folder import Results, where
from socialiq.types import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WITHIN = 20.0
"""Largest distance in degrees from the goal of a run that has adapted (Fig D.1)."""


def stop_maps(rows: Sequence[Row], title: str) -> Figure | None:
    """Draw Fig 6.4: share of STOP by the places of both vehicles, a column for each policy.

    Args:
        rows: Rows of `evaluation.stops.stop_rows`, of at least one policy.
        title: Title of the figure.

    Returns:
        The figure; None without rows.
    """
    policies = {row["policy"] for row in rows}
    specification = {
        "table": "stops",
        "kind": "heatmap",
        "panels": "policy",
        "x": "y_2",
        "by": "y_1",
        "y": ["weighted", "unweighted"],
        "columns": len(policies),
        "size": [3.0, 3.2] if len(policies) > 3 else [4.4, 4.0],
        "limits": [0, 1],
        "xlabel": "vehicle 2 at y (-1: none)",
        "ylabel": "vehicle 1 at y (-1: none)",
        "zlabel": "share of STOP",
        "title": title,
    }
    return draw(specification, Results("stops", {}, {"stops": list(rows)}, {}, {}))


def adaptation(rows: Sequence[Row], title: str, goal: float) -> Figure:
    """Draw Fig D.1: the angle over the updates for each λ, and when runs come to stay near a goal.

    Args:
        rows: Checkpoints, with `strength`, `seed`, `updates` and `angle` in degrees.
        title: Title of the figure.
        goal: Angle in degrees, of the optimum at the target for instance.

    Returns:
        The figure; a cross marks a run that is not near the goal at its end.
    """
    strengths = sorted({row["strength"] for row in rows})
    drawing = style.figure(11.0, 4.4)
    left, right = drawing.subplots(1, 2)
    last = max(row["updates"] for row in rows)
    for strength, color in colors_of(strengths).items():
        runs = where(rows, {"strength": strength})
        marks = {"color": color, "label": f"λ = {strength:g}"}
        style.band(left, runs, "updates", "angle", **marks)
        for seed in sorted({row["seed"] for row in runs}):
            steps = sorted(where(runs, {"seed": seed}), key=lambda row: row["updates"])
            near = [abs((row["angle"] - goal + 180) % 360 - 180) < WITHIN for row in steps]
            update = settled([row["updates"] for row in steps], near)
            height, mark = (last, "x") if update == "" else (update, ".")
            right.plot([strength], height, mark, color="red" if update == "" else color)
    left.axhline(goal, color="#999999", linewidth=0.8, linestyle=":")
    style.finish(left, xlabel="updates", ylabel="angle (degrees), mean and range of seeds")
    words = f"updates until within {WITHIN:g}° of {goal:.0f}° to the end"
    style.finish(right, xlabel="λ", ylabel=words)
    style.head(drawing, title, legend=True)
    return drawing


def settled(updates: Sequence[int], near: Sequence[bool]) -> int | str:
    """Return the first update from which on all angles are near the goal.

    Args:
        updates: Numbers of updates of the checkpoints, rising.
        near: Whether the angle of each checkpoint is near.

    Returns:
        Number of updates, or an empty string if the last angle is not near.
    """
    away = np.flatnonzero(~np.asarray(near, bool))
    after: Any = away[-1] + 1 if len(away) else 0
    return updates[after] if after < len(updates) else ""
