"""One dial against an agent for each angle, in the intersection: from nothing to tables, resumable.

Dials and agents differ in their range of angles and in their number of updates, and in nothing
else. All are driven on the intersection study's evaluation seeds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq.evaluation.front import hypervolume
from socialiq.experiments.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    atlas_demonstrations,
)
from socialiq.experiments.intersection.dial_jobs import (
    DIAL,
    DialRun,
    Turning,
    drive,
    file_of,
    train_dial,
)
from socialiq.experiments.intersection.episodes import load_episodes
from socialiq.experiments.intersection.rows import Played, policy_row, times
from socialiq.experiments.jobs import Job
from socialiq.experiments.results import from_csv
from socialiq.experiments.study import Context, Findings
from socialiq.experiments.tables import numeric_means, paired_row, with_holm
from socialiq.social.angle import exact_weights
from socialiq.studies.intersection_dial.config import Config
from socialiq.types import Row

DIALS, AGENTS = "dial", "agents"


def plan(config: Config) -> list[Job]:
    """Every job, each after its inputs."""
    jobs = [atlas_demonstrations(config.pool_episodes)]
    for seed in config.seeds:
        jobs += _trained(config, config.structure, config.turned, dial_name(seed), seed)
        for angle in config.key_angles:
            structure = dataclasses.replace(
                config.structure, low=angle, high=angle, margin=0.0, updates=config.agent_updates
            )
            jobs += _trained(config, structure, (angle,), agent_name(angle, seed), seed)
    return jobs


def dial_name(seed: int) -> str:
    """Folder of a dial."""
    return f"dials/{seed}"


def agent_name(angle: float, seed: int) -> str:
    """Folder of an agent."""
    return f"agents/{angle:g}/{seed}"


def _trained(
    config: Config, structure: Any, angles: tuple[float, ...], name: str, seed: int
) -> Iterator[Job]:
    """Training, then driving at these angles."""
    numbers = dataclasses.replace(config.numbers, seed=seed)
    learning = DialRun(structure, numbers, config.mixture, config.size, config.steps_per_update)
    if len(angles) == 1:
        learning = dataclasses.replace(learning, check_angles=angles)
    yield Job(name, train_dial, learning, (DEMONSTRATIONS,), cost=structure.updates / 150)
    driving = Turning(angles, config.episodes)
    yield Job(f"evaluation/{name}", drive, driving, (name,), cost=3.0 * len(angles))


class Driven(NamedTuple):
    """A dial or agent at an angle.

    Attributes:
        family: DIALS or AGENTS.
        seed: Training seed.
        angle: The requested angle, in degrees.
        row: Everything of thesis 5.4 about it.
    """

    family: str
    seed: int
    angle: float
    row: Row

    @property
    def point(self) -> tuple[float, float]:
        """Mean totals."""
        return self.row["r_env"], self.row["r_social"]


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the dial of the first seed."""
    jobs, work = context.jobs, context.work
    first = (work / dial_name(config.seeds[0]) / DIAL).read_bytes()
    driven = list(_driven(config, work))
    families = _families(config, driven)
    trained = [job for job in jobs if job.work is train_dial]
    tables = {
        "policies": _policies(config, driven),
        "families": families,
        "differences": _differences(families) if len(config.seeds) > 1 else [],
        "curves": [
            {"run": job.name} | row
            for job in trained
            for row in from_csv(work / job.name / "curve.csv")
        ],
        "times": times(trained, work),
    }
    return Findings(tables, _summary(config, tables), {DIAL: first})


def _driven(config: Config, work: Path) -> Iterator[Driven]:
    for seed in config.seeds:
        runs = [(DIALS, dial_name(seed), angle) for angle in config.turned]
        runs += [(AGENTS, agent_name(angle, seed), angle) for angle in config.key_angles]
        for family, name, angle in runs:
            episodes = load_episodes(work / "evaluation" / name / file_of(angle))
            yield Driven(family, seed, angle, policy_row(Played(name, "greedy", episodes)))


def _policies(config: Config, driven: Sequence[Driven]) -> list[Row]:
    """Metrics of each policy, its J(α) at the requested angle, and its regret there."""
    best = _best(config, driven)
    found: list[Row] = []
    for one in driven:
        label = {"family": one.family, "seed": one.seed, "asked": one.angle}
        value = _value(one.point, one.angle)
        regret = best[one.angle] - value
        numbers = {key: v for key, v in one.row.items() if key not in ("policy", "readout")}
        found.append(label | {"value": value, "regret": regret} | numbers)
    return found


def _best(config: Config, driven: Sequence[Driven]) -> dict[float, float]:
    """At each angle the J(α) of the best policy of all, of either family, any seed and angle."""
    return {angle: max(_value(one.point, angle) for one in driven) for angle in config.turned}


def _value(point: tuple[float, float], angle: float) -> float:
    """J(α) of mean totals (Eq 4.3)."""
    direction = exact_weights(angle)
    return direction.env * point[0] + direction.social * point[1]


def _families(config: Config, driven: Sequence[Driven]) -> list[Row]:
    """Each family of each seed in numbers, at the key angles."""
    best = _best(config, driven)
    corner = np.array([one.point for one in driven]).min(axis=0)
    rows: list[Row] = []
    for family in (DIALS, AGENTS):
        for seed in config.seeds:
            mine = sorted(
                (one for one in driven if (one.family, one.seed) == (family, seed)),
                key=lambda one: one.angle,
            )
            key = [one for one in mine if one.angle in config.key_angles]
            points = np.array([one.point for one in key])
            regrets = {one.angle: best[one.angle] - _value(one.point, one.angle) for one in key}
            turns = np.diff(np.array([one.point for one in mine]), axis=0)
            rows.append(
                {
                    "family": family,
                    "seed": seed,
                    "hypervolume": hypervolume(points, corner),
                    "mean_regret": float(np.mean(list(regrets.values()))),
                    "worst_regret": max(regrets.values()),
                }
                | {f"regret_{angle:g}": value for angle, value in regrets.items()}
                | {
                    "angles": len(mine),
                    "rise_r_env": float(max(turns[:, 0].max(), 0.0)),
                    "drop_r_social": float(max(-turns[:, 1].min(), 0.0)),
                    "most_arrivals": max(one.row["arrival"] for one in mine),
                }
            )
    return rows


def _differences(families: list[Row]) -> list[Row]:
    """Dial against agents, paired over training seeds, Holm over all rows."""
    found: list[Row] = []
    names = [name for name in families[0] if name == "hypervolume" or "regret" in name]
    for name in names:
        dial, agents = (
            [row[name] for row in families if row["family"] == family] for family in (DIALS, AGENTS)
        )
        found.append(paired_row({"measure": name}, dial, agents))
    return with_holm(found)


def _summary(config: Config, tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Means over seeds: of each family, and of each policy by family and angle."""
    found: dict[str, Any] = {"families": {}, "policies": {}}
    for family in (DIALS, AGENTS):
        mine = [row for row in tables["families"] if row["family"] == family]
        found["families"][family] = _mean(mine)
        for angle in config.turned:
            rows = [
                row
                for row in tables["policies"]
                if (row["family"], row["asked"]) == (family, angle)
            ]
            if rows:
                found["policies"].setdefault(family, {})[f"{angle:g}"] = _mean(rows)
    found["differences"] = {row["measure"]: row for row in tables.get("differences", [])}
    return found


def _mean(rows: list[Row]) -> Row:
    """Means of what has numbers in all rows."""
    means = {name: value for name, value in numeric_means(rows).items() if name != "seed"}
    return means | {"seeds": len({row["seed"] for row in rows})}
