"""Online planning for the intersection's egoist."""

from __future__ import annotations

from socialiq.experiments.intersection.experts import SHARES
from socialiq.experiments.study import Study, view_of
from socialiq.studies.intersection_ahead.figures import draw
from socialiq.studies.intersection_ahead.study import Config, compute_tables, plan

STUDY = Study(
    name="intersection-ahead",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "policies",
        "policy",
        *SHARES,
        title="shares of episodes; foresight: with one look at the true future",
    ),
)
