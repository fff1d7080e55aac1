"""The egoist alone, with online planning, and with a look at the true future."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.experiments.intersection.plots import dots, with_target
from socialiq.experiments.results import Results
from socialiq.studies.intersection_ahead.study import TRAFFIC
from socialiq.types import Row

LABELS = {
    "experts": "network alone",
    "ahead": "online planning",
    "foresight": "one look at the future",
}
WHERE = {
    "as_believed": "as believed",
    "varied_drivers": "varied drivers",
    "connected_lanes": "connected lanes",
}


def draw(results: Results) -> dict[str, Figure]:
    """All figures of the study."""
    return {"egoists": egoists(results), "elsewhere": elsewhere(results)}


def egoists(results: Results) -> Figure:
    """Collisions and arrivals of every training seed."""
    rows = {row["policy"]: row for row in results.tables["policies"]}
    every: list[tuple[list[str], Row]] = [
        ([label, str(seed)], rows[f"{stage}/set/egoistic/{seed}"])
        for stage, label in LABELS.items()
        for seed in results.config["seeds"]
    ]
    return _drawn(
        every, "Intersection: the egoist that sees a set", "dot: a seed, bar: mean", results
    )


def elsewhere(results: Results) -> Figure:
    """The atlas' egoist in the traffic that it believes in and in others."""
    rows = {row["policy"]: row for row in results.tables["policies"]}
    every: list[tuple[list[str], Row]] = [
        ([f"{WHERE[traffic]}: {label}", traffic], rows[f"atlas/egoistic/{traffic}/{kind}"])
        for traffic in TRAFFIC
        for kind, label in (("plain", "network alone"), ("ahead", "online planning"))
    ]
    return _drawn(every, "Intersection: the atlas' egoist among other drivers", "", results)


def _drawn(every: list[tuple[list[str], Row]], title: str, marks: str, results: Results) -> Figure:
    drawn, panels = dots(every, 3.0)
    with_target(panels, results.summary["target"])
    about = f"{every[0][1]['episodes']} episodes each; dashed: what a good egoist should reach"
    drawn.suptitle(f"{title}\n{about}{'; ' * bool(marks)}{marks}", fontsize=10)
    return drawn
