"""Coverage of the audit's intervals and error rates of its verdicts, on simulated drivers."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.audit_power.figures import draw
from socialiq.studies.audit_power.study import Config, compute_tables

STUDY = Study(
    name="audit-power",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of("verdicts"),
)
