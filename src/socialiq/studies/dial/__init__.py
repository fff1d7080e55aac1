"""The dial in the 7x7 world against the exact optimum of each angle."""

from __future__ import annotations

from socialiq.experiments.study import Study, view_of
from socialiq.studies.dial.config import Config
from socialiq.studies.dial.figures import draw
from socialiq.studies.dial.study import compute_tables

STUDY = Study(
    name="dial",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "pooled",
        "run",
        "readout",
        "key_regret_mean",
        "key_regret_high",
        "ceiling_mean",
        "rise_r_env_high",
        "drop_r_social_high",
        "least_share_of_support_low",
        title="over seeds; key regret: mean regret at 0, 15, ..., 90 degrees, exact",
    ),
)
