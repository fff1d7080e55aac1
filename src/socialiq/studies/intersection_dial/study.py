"""The dial in the intersection, beside agents trained for one angle each.

Dials and agents differ only in their range of angles and in their number of updates. All are
evaluated on the intersection study's seeds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.front import hypervolume
from socialiq.experiments.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    MIXTURE,
    RECORDED_EPISODES,
    SIZE,
    atlas_demonstrations,
)
from socialiq.experiments.intersection.driving import DialEvaluation, evaluate_dial
from socialiq.experiments.intersection.episodes import DIAL, EPISODES, angle_file, load_episodes
from socialiq.experiments.intersection.rows import curves, policy_row, times
from socialiq.experiments.intersection.training import (
    DIAL_NUMBERS,
    DIAL_STRUCTURE,
    MixtureDialRun,
    train_dial,
)
from socialiq.experiments.jobs import Job
from socialiq.experiments.study import Context, Findings
from socialiq.experiments.tables import groups, matching, numeric_means, paired_differences
from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.social.angle import exact_weights
from socialiq.types import Row

DIALS, AGENTS = "dial", "agents"


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (50, 51, 52, 53, 54)
    """Training seeds, each with a mixture of demonstrations of its own. 120 was used in
    development."""
    key_angles: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 15.0).tolist())
    """Angles that an agent is trained for, and at which regrets are counted, in degrees."""
    turned: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 5.0).tolist())
    """Angles at which a dial is driven; the key angles are among them."""
    structure: StaticConfig = DIAL_STRUCTURE
    """Static config of a dial."""
    numbers: Hyperparameters = DIAL_NUMBERS
    """Hyperparameters of dials and agents, without the seed."""
    agent_updates: int = 12_000
    """Gradient steps of an agent of one angle; all agents of a seed take twice a dial's."""
    steps_per_update: int = 12
    """Environment steps for each gradient step."""
    pool_episodes: int = RECORDED_EPISODES
    """Episodes recorded of each expert of the atlas, as in the intersection study."""
    mixture: str = MIXTURE
    """Mixture of the three experts' demonstrations, as in the intersection study."""
    size: int = SIZE
    """Transitions of each expert in a mixture."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the intersection study's own."""

    def __post_init__(self) -> None:
        """Refuse empty sizes, and key angles at which no dial is driven."""
        if not self.seeds:
            raise UserError("name at least one training seed")
        if not set(self.key_angles) <= set(self.turned):
            raise UserError("every key angle must be among the angles at which a dial is driven")
        for name in ("agent_updates", "steps_per_update", "pool_episodes", "size", "episodes"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} must be at least 1, got {getattr(self, name)}")


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    jobs = [atlas_demonstrations(config.pool_episodes)]
    for seed in config.seeds:
        jobs += _training(config, config.structure, config.turned, dial_name(seed), seed)
        for angle in config.key_angles:
            structure = dataclasses.replace(
                config.structure, low=angle, high=angle, margin=0.0, updates=config.agent_updates
            )
            jobs += _training(config, structure, (angle,), agent_name(angle, seed), seed)
    return jobs


def dial_name(seed: int) -> str:
    """Return the folder of a dial."""
    return f"dials/{seed}"


def agent_name(angle: float, seed: int) -> str:
    """Return the folder of an agent."""
    return f"agents/{angle:g}/{seed}"


def _training(
    config: Config, structure: StaticConfig, angles: tuple[float, ...], name: str, seed: int
) -> Iterator[Job]:
    """Train, then drive at these angles."""
    run = MixtureDialRun(
        structure=structure,
        numbers=dataclasses.replace(config.numbers, seed=seed),
        size=config.size,
        steps_per_update=config.steps_per_update,
        mixture=config.mixture,
    )
    if len(angles) == 1:
        run = dataclasses.replace(run, check_angles=angles)
    yield Job(name, train_dial, run, (DEMONSTRATIONS,), cost=structure.updates / 150)
    driving = DialEvaluation(angles, episodes=config.episodes)
    cost = 3.0 * len(angles)
    yield Job(f"evaluation/{name}", evaluate_dial, driving, (name,), cost=cost)


class Evaluated(NamedTuple):
    """Evaluation of a dial or agent at an angle.

    Attributes:
        family: DIALS or AGENTS.
        seed: Training seed.
        angle: The requested angle, in degrees.
        row: Metrics of thesis 5.4.
    """

    family: str
    seed: int
    angle: float
    row: Row

    @property
    def point(self) -> tuple[float, float]:
        """Mean totals."""
        return self.row["r_env"], self.row["r_social"]

    def value(self, angle: float) -> float:
        """Return J(α) of the mean totals (Eq 4.3)."""
        direction = exact_weights(angle)
        return direction.env * self.point[0] + direction.social * self.point[1]


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the dial of the first seed."""
    work = context.work
    every = list(_evaluated(config, work))
    best = {angle: max(one.value(angle) for one in every) for angle in config.turned}
    families = _families(config, every, best)
    trained = [job for job in context.jobs if job.work is train_dial]
    measures = [name for name in families[0] if name == "hypervolume" or "regret" in name]
    dials, agents = (matching(families, family=family) for family in (DIALS, AGENTS))
    tables = {
        "policies": _policies(every, best),
        "families": families,
        "differences": paired_differences(dials, agents, *measures, label="measure"),
        "curves": curves(trained, work, columns=None),
        "times": times(trained, work),
    }
    first = (work / dial_name(config.seeds[0]) / DIAL).read_bytes()
    return Findings(tables, _summary(tables), {DIAL: first})


def _evaluated(config: Config, work: Path) -> Iterator[Evaluated]:
    for seed in config.seeds:
        runs = [(DIALS, dial_name(seed), angle) for angle in config.turned]
        runs += [(AGENTS, agent_name(angle, seed), angle) for angle in config.key_angles]
        for family, name, angle in runs:
            episodes = load_episodes(work / "evaluation" / name / angle_file(angle))
            yield Evaluated(family, seed, angle, policy_row(name, "greedy", episodes))


def _policies(every: Sequence[Evaluated], best: Mapping[float, float]) -> list[Row]:
    """Return metrics of each policy, its J(α) at the requested angle, and its regret there."""
    found: list[Row] = []
    for one in every:
        label = {"family": one.family, "seed": one.seed, "asked": one.angle}
        value = one.value(one.angle)
        metrics = {name: v for name, v in one.row.items() if name not in ("policy", "readout")}
        found.append(label | {"value": value, "regret": best[one.angle] - value} | metrics)
    return found


def _families(config: Config, every: Sequence[Evaluated], best: Mapping[float, float]) -> list[Row]:
    """Return hypervolume, regrets at the key angles and monotony of each family and seed."""
    corner = np.array([one.point for one in every]).min(axis=0)
    rows: list[Row] = []
    for family in (DIALS, AGENTS):
        for seed in config.seeds:
            mine = [one for one in every if (one.family, one.seed) == (family, seed)]
            mine.sort(key=lambda one: one.angle)
            key = [one for one in mine if one.angle in config.key_angles]
            regrets = {one.angle: best[one.angle] - one.value(one.angle) for one in key}
            turns = np.diff(np.array([one.point for one in mine]), axis=0)
            rows.append(
                {
                    "family": family,
                    "seed": seed,
                    "hypervolume": hypervolume(np.array([one.point for one in key]), corner),
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


def _summary(tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return means over seeds of each family, and of each policy by family and angle."""
    families = groups(tables["families"], "family")
    policies: dict[str, Any] = {DIALS: {}, AGENTS: {}}
    for (family, angle), rows in groups(tables["policies"], "family", "asked").items():
        policies[family][f"{angle:g}"] = _mean(rows)
    return {
        "families": {family: _mean(rows) for (family,), rows in families.items()},
        "policies": policies,
        "differences": {row["measure"]: row for row in tables["differences"]},
    }


def _mean(rows: list[Row]) -> Row:
    """Return the means of columns with numbers in all rows."""
    means = {name: value for name, value in numeric_means(rows).items() if name != "seed"}
    return means | {"seeds": len({row["seed"] for row in rows})}
