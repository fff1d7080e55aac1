"""The 7x7 study (thesis 6.2, Figs 6.2-6.4)."""

from __future__ import annotations

from collections.abc import Sequence

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.results import Results
from socialiq.experiments.study import Study, View
from socialiq.studies.grid.figures import THESIS_ANGLES, draw
from socialiq.studies.grid.study import Config, compute_tables
from socialiq.types import Row


def view(results: Results) -> Sequence[View]:
    """Return the policies of the figures beside the thesis' and the optimum's angles."""
    return [View(comparison(results), "angle in degrees; greedy, means over seeds, exact")]


def comparison(results: Results) -> list[Row]:
    """Return target angle, our angle, the thesis' and the optimum's, for the figures' policies."""
    rows: list[Row] = []
    for name, angle in {"baseline": None, **MODES}.items():
        entry = results.summary["policies"][f"{name}_greedy"]
        expert = results.summary["experts"].get(name, {})
        rows.append(
            {
                "policy": name,
                "target": "none" if angle is None else f"{angle:g}",
                "angle": entry["angle"],
                "thesis": THESIS_ANGLES[name],
                "optimum": expert.get("angle", ""),
                "regret": "" if angle is None else entry["regret"],
                "arrival": entry["arrival"],
                "timeout": entry["timeout"],
            }
        )
    return rows


STUDY = Study(
    name="grid",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view,
)
