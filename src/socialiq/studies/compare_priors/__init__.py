"""Every place where the social prior can enter, and the baselines, at one budget."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from socialiq.experiments.results import Results
from socialiq.experiments.study import Study, View
from socialiq.studies.compare_priors.config import Config
from socialiq.studies.compare_priors.figures import draw, quantity, strength
from socialiq.studies.compare_priors.methods import LABELS
from socialiq.studies.compare_priors.study import chosen_jobs, compute_tables, development_jobs
from socialiq.types import Row


def view(results: Results) -> Sequence[View]:
    """Return a table of methods by target angle for each world and action selection."""
    found = []
    for world in dict.fromkeys(row["world"] for row in results.tables["pooled"]):
        for readout in ("greedy", "soft"):
            rows = table(results, world, readout)
            title = f"{world}, {readout}: {quantity(results, world)} at the target angle"
            found += [View(rows, f"{title}, mean over seeds")] if rows else []
    return found


def table(results: Results, world: str, readout: str) -> list[Row]:
    """Return a row for each method with its λ; columns are target angles in degrees."""
    found: dict[str, Row] = {}
    measured = quantity(results, world)
    for row in results.tables["pooled"]:
        if (row["world"], row["readout"]) == (world, readout):
            scale: Any = strength(row)
            label = {"method": LABELS[row["method"]], "λ": scale}
            shown = found.setdefault(row["method"], label)
            shown[f"{row['target_angle']:g}°"] = row[measured]
    return list(found.values())


STUDY = Study(
    name="compare-priors",
    Config=Config,
    jobs=development_jobs,
    more_jobs=chosen_jobs,
    tables=compute_tables,
    figures=draw,
    view=view,
)
