"""The intersection under rule-based drivers (thesis 5.1.3)."""

from __future__ import annotations

from socialiq.experiments.intersection.rows import OUTCOMES
from socialiq.experiments.study import Study, view_of
from socialiq.studies.intersection_world.figures import draw
from socialiq.studies.intersection_world.study import Config, compute_tables

STUDY = Study(
    name="intersection-world",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "outcomes",
        "population",
        "driver",
        *OUTCOMES,
        "ego_struck",
        "speed_kmh",
        title="shares of episodes; ego_struck: the ego ran into another",
    ),
)
