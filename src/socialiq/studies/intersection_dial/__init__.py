"""The dial in the intersection, beside agents trained for one angle each."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.intersection_dial.figures import draw
from socialiq.studies.intersection_dial.study import Config, compute_tables, plan

STUDY = Study(
    name="intersection-dial",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "families",
        "family",
        "seed",
        "hypervolume",
        "mean_regret",
        "worst_regret",
        "rise_r_env",
        "drop_r_social",
        "most_arrivals",
        title="regret against the best policy of all, over the key angles",
    ),
)
