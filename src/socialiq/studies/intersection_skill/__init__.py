"""A skill that demonstrators share and the reward pair lacks, in the intersection."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.intersection_skill.figures import draw
from socialiq.studies.intersection_skill.plan import Config, plan
from socialiq.studies.intersection_skill.tables import compute_tables

STUDY = Study(
    name="intersection-skill",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view_of("pooled"),
)
