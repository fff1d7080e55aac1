"""Value of demonstrations beyond reinforcement learning on R(α), solved exactly."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.competence.bench import Config
from socialiq.studies.competence.figures import draw
from socialiq.studies.competence.study import compute_tables

STUDY = Study(
    name="competence",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of("pooled"),
)
