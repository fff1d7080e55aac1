"""`compare priors`: choose each method's λ on seeds of development, then fill the table on others.

Every method of a world has the same updates, steps in the world, network, rates and data sets.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.metrics import Metrics, mean_of
from socialiq.experiments.intersection.demonstration_sets import (
    RECORDED_EPISODES,
    atlas_demonstrations,
)
from socialiq.experiments.jobs import Job
from socialiq.experiments.results import from_csv
from socialiq.experiments.study import Context, Findings
from socialiq.experiments.tables import groups
from socialiq.studies.compare_priors import intersection
from socialiq.studies.compare_priors.alignment import alignment, counts
from socialiq.studies.compare_priors.config import EPISODES_EACH, GRIDWORLDS, Config
from socialiq.studies.compare_priors.gridworlds import ROWS, GridRun, references, run_method
from socialiq.studies.compare_priors.methods import BY_NAME, THESIS_STRENGTHS, Method
from socialiq.types import Row

KEYS = ("world", "method", "strength", "target_angle", "readout")
DEVELOPMENT, FRESH = "development", "fresh"

Chosen = Mapping[tuple[str, str], float]
"""λ by world and method."""


def development_jobs(config: Config) -> list[Job]:
    """Every method that has a λ, at each λ."""
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
    run_of = GridRun(
        world,
        method,
        config.structure,
        config.numbers,
        angles,
        strengths,
        seeds,
        EPISODES_EACH[world],
    )
    runs = len(seeds) * len(strengths) * (len(angles) if method.by_angle else 1)
    yield Job(_name(phase, world, method), run_method, run_of, cost=runs + 10.0)


def _name(phase: str, world: str, method: Method) -> str:
    return f"priors/{world}/{phase}/{method.name}"


def development_rows(config: Config, work: Path) -> Iterator[Row]:
    """Results of the seeds of development."""
    for world in config.worlds:
        for method in _scaled(config):
            strengths = _strengths(config, world)
            yield from _rows(config, work, DEVELOPMENT, world, method, strengths)


def fresh_rows(config: Config, chosen: Chosen, work: Path) -> Iterator[Row]:
    """Rows of the table."""
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


def choose(rows: Sequence[Row]) -> dict[tuple[str, str], float]:
    """For each world and method the λ with the greatest mean J(α).

    The mean is over angles, seeds and readouts; J*(α) is the same for all λ, so this is also the
    least mean regret. Of equal ones the smaller λ is taken.
    """
    values: dict[tuple[str, str], dict[float, list[float]]] = {}
    for row in rows:
        by_strength = values.setdefault((row["world"], row["method"]), {})
        by_strength.setdefault(float(row["strength"]), []).append(row["value"])
    return {
        key: max(sorted(found), key=lambda strength: round(float(np.mean(found[strength])), 9))
        for key, found in values.items()
    }


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute rows, their means over seeds, and what the choice of λ was made from."""
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
    summary = _summary(pooled) | {"alignment": counts(aligned)}
    return Findings(tables, summary)


def means(rows: Sequence[Row]) -> list[Row]:
    """Means over seeds; α̂ is that of the mean totals, low and high are of single seeds."""
    found: list[Row] = []
    for values, group in groups(rows, *KEYS).items():
        metrics = mean_of([Metrics(*(row[name] for name in Metrics._fields)) for row in group])
        found.append(
            dict(zip(KEYS, values, strict=True))
            | {"seeds": len(group)}
            | metrics._asdict()
            | _spread(group, "value")
            | _spread(group, "regret")
            | {"effective_share": _mean(group, "effective_share")}
        )
    return found


def overall(pooled: Sequence[Row]) -> list[Row]:
    """Each method over all target angles: mean J(α), mean regret, and its regret where it is worst.

    Regrets are empty where no optimum is known.
    """
    keys = ("world", "method", "strength", "readout")
    return [
        dict(zip(keys, values, strict=True))
        | {"angles": len(group), "value": _mean(group, "value"), "regret": _mean(group, "regret")}
        | {"worst_regret": "" if group[0]["regret"] == "" else max(r["regret"] for r in group)}
        for values, group in groups(pooled, *keys).items()
    ]


def _spread(group: Sequence[Row], name: str) -> Row:
    if any(row[name] == "" for row in group):
        return {name: "", f"{name}_low": "", f"{name}_high": ""}
    values = [row[name] for row in group]
    return {
        name: float(np.mean(values)),
        f"{name}_low": min(values),
        f"{name}_high": max(values),
    }


def _mean(group: Sequence[Row], name: str) -> float | str:
    return "" if group[0][name] == "" else float(np.mean([row[name] for row in group]))


def _summary(pooled: Sequence[Row]) -> dict[str, Any]:
    """λ, α̂, arrival and what a policy is worth, by world, method, readout and target angle."""
    found: dict[str, Any] = {}
    for row in pooled:
        method = found.setdefault(row["world"], {}).setdefault(row["method"], {})
        method["strength"] = row["strength"]
        entry = method.setdefault(row["readout"], {})
        names = ("value", "regret", "regret_low", "regret_high", "angle", "arrival")
        entry[f"{row['target_angle']:g}"] = {name: row[name] for name in names}
    return found
