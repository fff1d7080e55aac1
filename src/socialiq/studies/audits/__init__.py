"""Audits of the thesis' printed tables and of this project's policies."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.audits.figures import draw
from socialiq.studies.audits.study import Config, compute_tables

STUDY = Study(
    name="audits",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "audits",
        "world",
        "policy",
        "declared",
        "truthful",
        "verdict",
        "decided_by",
        "regret",
        title="regret at the declared angle, in reward per episode",
    ),
)
