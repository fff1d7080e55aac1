"""IQ-Learn on classic control from few transitions, an outside check."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.classic_control.figures import draw
from socialiq.studies.classic_control.study import Config, compute_tables

STUDY = Study(
    name="classic-control",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of("returns"),
)
