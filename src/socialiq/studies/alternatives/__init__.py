"""Other places where the prior could enter (thesis appendix B), trained in the 7x7 world."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.alternatives.figures import draw
from socialiq.studies.alternatives.study import Config, compute_tables

STUDY = Study(
    name="alternatives",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of("pooled"),
)
