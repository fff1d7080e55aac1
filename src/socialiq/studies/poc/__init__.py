"""The 5x5 proof of concept (thesis 6.1, Fig 6.1)."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.poc.figures import draw
from socialiq.studies.poc.study import Config, compute_tables

STUDY = Study(
    name="poc",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of("agreement"),
)
