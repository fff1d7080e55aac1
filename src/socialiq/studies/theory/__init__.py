"""The statements and predictions of the theory against exact minima and trained networks."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.theory.figures import draw
from socialiq.studies.theory.study import Config, compute_tables

STUDY = Study(
    name="theory",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of("predicted"),
)
