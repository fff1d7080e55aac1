"""`compare priors`: choose each method's λ on development seeds, then train on other seeds.

Every method of a world has the same updates, environment steps, network, rates and data sets.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from socialiq.types import Row
from socialiq_lab.comparison import EPISODES_EACH, GRIDWORLDS, references
from socialiq_lab.comparison_figures import quantity
from socialiq_lab.intersection.demonstration_sets import (
    RECORDED_EPISODES,
    atlas_demonstrations,
)
from socialiq_lab.jobs import Job
from socialiq_lab.results import Results, from_csv
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import groups, matching
from studies.compare_priors import intersection
from studies.compare_priors.config import (
    BY_NAME,
    LABELS,
    THESIS_STRENGTHS,
    Config,
    Method,
)
from studies.compare_priors.figures import draw_figures, strength
from studies.compare_priors.gridworlds import ROWS, GridRun, run_method
from studies.compare_priors.tables import (
    Chosen,
    alignment,
    alignment_counts,
    choose,
    means,
    overall,
    summarise,
)

DEVELOPMENT, FRESH = "development", "fresh"


def development_jobs(config: Config) -> list[Job]:
    """Return the jobs of every method with a λ, at each λ."""
    jobs: list[Job] = []
    for world in config.worlds:
        jobs += [] if world in GRIDWORLDS else [atlas_demonstrations(RECORDED_EPISODES)]
        for method in _scaled(config):
            strengths = _strengths(config, world)
            jobs += _jobs(config, DEVELOPMENT, world, method, strengths)
    return jobs


def chosen_jobs(config: Config, work: Path) -> list[Job]:
    """Return every method's jobs at the λ that the development jobs' folders choose."""
    return fresh_jobs(config, choose(list(development_rows(config, work))))


def fresh_jobs(config: Config, chosen: Chosen) -> list[Job]:
    """Return every method's jobs at its λ."""
    jobs: list[Job] = []
    for world in config.worlds:
        jobs += [] if world in GRIDWORLDS else [atlas_demonstrations(RECORDED_EPISODES)]
        for method in _methods(config):
            strengths = (_strength(world, method, chosen),)
            jobs += _jobs(config, FRESH, world, method, strengths)
    return jobs


def _methods(config: Config) -> list[Method]:
    return [BY_NAME[name] for name in config.methods]


def _scaled(config: Config) -> list[Method]:
    return [method for method in _methods(config) if method.scaled]


def _strengths(config: Config, world: str) -> tuple[float, ...]:
    return config.strengths if world in GRIDWORLDS else config.intersection_strengths


def _strength(world: str, method: Method, chosen: Chosen) -> float:
    return chosen[world, method.name] if method.scaled else THESIS_STRENGTHS[world]


def _seeds(config: Config, phase: str, world: str) -> tuple[int, ...]:
    if world in GRIDWORLDS:
        return config.seeds if phase == FRESH else config.development_seeds
    return config.intersection_seeds if phase == FRESH else config.intersection_development_seeds


def _jobs(
    config: Config, phase: str, world: str, method: Method, strengths: tuple[float, ...]
) -> Iterator[Job]:
    seeds = _seeds(config, phase, world)
    if world not in GRIDWORLDS:
        yield from intersection.jobs_of(config, phase, method, strengths, seeds)
        return
    angles = config.angles if phase == FRESH else config.development_angles
    sizes = (angles, strengths, seeds, EPISODES_EACH[world])
    grid = GridRun(world, method, config.structure, config.numbers, *sizes)
    runs = len(seeds) * len(strengths) * (len(angles) if method.by_angle else 1)
    yield Job(_name(phase, world, method), run_method, grid, cost=runs + 10.0)


def _name(phase: str, world: str, method: Method) -> str:
    return f"priors/{world}/{phase}/{method.name}"


def development_rows(config: Config, work: Path) -> Iterator[Row]:
    """Yield the rows of the development seeds."""
    for world in config.worlds:
        for method in _scaled(config):
            strengths = _strengths(config, world)
            yield from _rows(config, work, DEVELOPMENT, world, method, strengths)


def fresh_rows(config: Config, chosen: Chosen, work: Path) -> Iterator[Row]:
    """Yield the rows of the table's seeds."""
    for world in config.worlds:
        for method in _methods(config):
            strengths = (_strength(world, method, chosen),)
            yield from _rows(config, work, FRESH, world, method, strengths)


def _rows(
    config: Config,
    work: Path,
    phase: str,
    world: str,
    method: Method,
    strengths: tuple[float, ...],
) -> list[Row]:
    if world in GRIDWORLDS:
        return from_csv(work / _name(phase, world, method) / ROWS)
    seeds = _seeds(config, phase, world)
    return intersection.rows_of(config, work, phase, method, strengths, seeds)


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute rows, their means over seeds, and the rows from which λ was chosen."""
    developed = list(development_rows(config, context.work))
    chosen = choose(developed)
    fresh = list(fresh_rows(config, chosen, context.work))
    pooled, aligned = means(fresh), alignment(fresh)
    tables = {
        "policies": fresh,
        "pooled": pooled,
        "overall": overall(pooled),
        "alignment": aligned,
        "references": [
            row
            for world in config.worlds
            if world in GRIDWORLDS
            for row in references(world, config.angles)
        ],
        "development": means(developed),
        "chosen": [
            {"world": world, "method": method, "strength": strength}
            for (world, method), strength in chosen.items()
        ],
    }
    summary = summarise(pooled) | {"alignment": alignment_counts(aligned)}
    return Findings(tables, summary)


def view(results: Results) -> Sequence[View]:
    """Return a table of methods by target angle for each world and action selection."""
    views = []
    for world in dict.fromkeys(row["world"] for row in results.tables["pooled"]):
        for readout in ("greedy", "soft"):
            rows = table(results, world, readout)
            title = f"{world}, {readout}: {quantity(results, world)} at the target angle"
            views += [View(rows, f"{title}, mean over seeds")] if rows else []
    return views


def table(results: Results, world: str, readout: str) -> list[Row]:
    """Return a row for each method with its λ; columns are target angles in degrees."""
    rows = matching(results.tables["pooled"], world=world, readout=readout)
    measured = quantity(results, world)
    return [
        {"method": LABELS[method], "λ": strength(group[0])}
        | {f"{row['target_angle']:g}°": row[measured] for row in group}
        for (method,), group in groups(rows, "method").items()
    ]


STUDY = Study(
    name="compare-priors",
    Config=Config,
    jobs=development_jobs,
    more_jobs=chosen_jobs,
    tables=compute_tables,
    figures=draw_figures,
    view=view,
)
