"""Exact facts about the two gridworlds and their experts (thesis 5.1, 5.2, Fig 6.3)."""

from __future__ import annotations

from collections.abc import Sequence

from socialiq.experiments.results import Results
from socialiq.experiments.study import Study, View
from socialiq.studies.worlds.figures import draw
from socialiq.studies.worlds.study import Config, compute_tables


def view(results: Results) -> Sequence[View]:
    """Return both worlds by reading."""
    angles = ("reading", "egoistic_angle", "prosocial_angle", "altruistic_angle")
    rows = [{key: row[key] for key in angles} for row in results.tables["crossing7_readings"]]
    return [
        View(results.tables["crossing5_readings"], "crossing5: experts by reading"),
        View(rows, "crossing7: angle of the optimum by reading, degrees"),
    ]


STUDY = Study(
    name="worlds",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view,
)
