"""Experts, demonstrations and learners of the intersection (thesis 5.2-6.3, 7, A)."""

from __future__ import annotations

from collections.abc import Sequence

from socialiq.experiments.results import Results
from socialiq.experiments.study import Study, View
from socialiq.experiments.tables import groups
from socialiq.studies.intersection.figures import draw
from socialiq.studies.intersection.plan import Config, plan
from socialiq.studies.intersection.study import compute_tables
from socialiq.types import Row


def view(results: Results) -> Sequence[View]:
    """Return Table 6.2 of the experts and of each group of learners, greedy, a row for a policy."""
    greedy = [row for row in results.tables["table_6_2"] if row["readout"] == "greedy"]
    found = []
    for (preset, setting), rows in groups(greedy, "preset", "setting").items():
        table: dict[str, Row] = {}
        for row in rows:
            printed = table.setdefault(row["policy"], {"policy": row["policy"]})
            printed[row["metric"]] = f"{row['ours']:.1f} ({row['thesis']:g})"
        found.append(View(list(table.values()), f"{preset}, {setting}: ours (thesis); %, km/h"))
    return found


STUDY = Study(
    name="intersection",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view,
)
