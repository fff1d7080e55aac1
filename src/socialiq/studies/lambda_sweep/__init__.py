"""The sweep of the regularization strength (thesis appendix D)."""

from __future__ import annotations

from collections.abc import Sequence

from socialiq.experiments.results import Results
from socialiq.experiments.study import Study, View
from socialiq.studies.lambda_sweep.figures import draw
from socialiq.studies.lambda_sweep.study import Config, compute_tables


def view(results: Results) -> Sequence[View]:
    """Return the first target of the sweep, and the baseline."""
    kind = results.config["target_kinds"][0]
    rows = [
        {key: row[key] for key in ("strength", "readout", "angle", "arrival", "length")}
        for row in results.tables["pooled"]
        if row["target_kind"] in ("baseline", kind)
    ]
    return [View(rows, f"{kind} target, means over seeds, exact")]


STUDY = Study(
    name="lambda-sweep",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view,
)
