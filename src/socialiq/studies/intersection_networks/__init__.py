"""The egoist's network: a flat list of vehicles, or a set."""

from __future__ import annotations

from socialiq.experiments.intersection.experts import SHARES
from socialiq.experiments.study import Study, view_of
from socialiq.studies.intersection_networks.figures import draw
from socialiq.studies.intersection_networks.study import Config, compute_tables, plan

STUDY = Study(
    name="intersection-networks",
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
