"""L1 and KL in the place of the quadratic prior (thesis 4.3.1), trained in the 7x7 world."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.penalties.figures import draw
from socialiq.studies.penalties.study import Config, compute_tables

STUDY = Study(
    name="penalties",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of("pooled"),
)
