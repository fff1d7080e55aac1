"""Offline learning in the intersection: demonstrations and their reward pairs, no step in a world.

One dial of `learners.offline` beside the demonstrators, clones and IQ-Learn, all with the network
that reads the vehicles as a set, from the same mixtures, on the same episodes. IQ-Learn is also
trained online, in the world.
"""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.plotting.style import band, figure, finish
from socialiq_lab.results import Results
from socialiq_lab.study import Study, view_of
from socialiq_lab.tables import groups, matching
from studies.intersection_offline.config import Config
from studies.intersection_offline.plan import plan
from studies.intersection_offline.tables import DEMONSTRATOR, compute_tables

_COLORS = (
    "#c23b22",
    "#6e6e6e",
    "#a6a6a6",
    "#1b7837",
    "#7fbf7b",
    "#2166ac",
    "#92c5de",
    "#762a83",
    "#c2a5cf",
)


def draw(results: Results) -> dict[str, Figure]:
    """Draw J(α) of every method, above that of the best demonstrator."""
    drawn = figure(7.5, 4.4)
    axes = drawn.subplots()
    rows = results.tables["policies"]
    best = {
        angle: max(r["value"] for r in group if r["method"].startswith(DEMONSTRATOR))
        for (angle,), group in groups(rows, "asked").items()
    }
    above = [row | {"above": row["value"] - best[row["asked"]]} for row in rows]
    names = dict.fromkeys(row["method"] for row in above if row["seed"] != "")
    for color, name in zip(_COLORS, names, strict=False):
        style = {"color": color, "marker": "o", "label": name}
        band(axes, matching(above, method=name), "asked", "above", **style)
    axes.axhline(0.0, color="black", linewidth=0.8)
    labels = {"xlabel": "angle asked for, degrees", "ylabel": "J(α) above the best demonstrator"}
    finish(axes, "Mean over seeds, band from least to largest", 9, **labels)
    return {"values": drawn}


STUDY = Study(
    name="intersection-offline",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "angles",
        "method",
        "asked",
        "value",
        "low",
        "high",
        "arrival",
        "collision",
        title="J(α) at the angle asked for, mean and range over training seeds",
    ),
)
