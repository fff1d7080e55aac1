"""The dial in the intersection, beside agents trained for one angle each.

Dials and agents differ only in their range of angles and in their number of updates. All are
evaluated on the intersection study's seeds.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

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
from socialiq.experiments.results import Results
from socialiq.experiments.study import Context, Findings, Study, view_of
from socialiq.experiments.tables import groups, matching, numeric_means, paired_differences
from socialiq.learners.config import check_counts
from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.plotting.rows import band, line
from socialiq.plotting.style import figure, finish
from socialiq.social.angle import exact_weights
from socialiq.types import Row

DIALS, AGENTS = "dial", "agents"
_LOOKS = {DIALS: ("#2166ac", "o", "one dial"), AGENTS: ("#c23b22", "^", "an agent each")}
_RATES = {"arrival": "#1b7837", "collision": "#c23b22", "timeout": "#6e6e6e"}


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
        check_counts(
            self, ("agent_updates", "steps_per_update", "pool_episodes", "size", "episodes")
        )


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


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the dial of the first seed."""
    work = context.work
    policies = _policies(config, work)
    families = _families(config, policies)
    trained = [job for job in context.jobs if job.work is train_dial]
    measures = [name for name in families[0] if name == "hypervolume" or "regret" in name]
    dials, agents = (matching(families, family=family) for family in (DIALS, AGENTS))
    tables = {
        "policies": policies,
        "families": families,
        "differences": paired_differences(dials, agents, *measures, label="measure"),
        "curves": curves(trained, work, columns=None),
        "times": times(trained, work),
    }
    first = (work / dial_name(config.seeds[0]) / DIAL).read_bytes()
    return Findings(tables, _summary(tables), {DIAL: first})


def _policies(config: Config, work: Path) -> list[Row]:
    """Return metrics of each policy, its J(α) at the requested angle, and its regret there."""
    rows: list[Row] = []
    for seed in config.seeds:
        runs = [(DIALS, dial_name(seed), angle) for angle in config.turned]
        runs += [(AGENTS, agent_name(angle, seed), angle) for angle in config.key_angles]
        for family, name, angle in runs:
            episodes = load_episodes(work / "evaluation" / name / angle_file(angle))
            row = {"family": family, "seed": seed, "asked": angle, "value": 0.0, "regret": 0.0}
            row |= policy_row(name, "greedy", episodes)
            rows.append({key: row[key] for key in row if key not in ("policy", "readout")})
    best = {angle: max(_value(row, angle) for row in rows) for angle in config.turned}
    for row in rows:
        row["value"] = _value(row, row["asked"])
        row["regret"] = best[row["asked"]] - row["value"]
    return rows


def _value(row: Row, angle: float) -> float:
    """Return J(α) of a policy's mean totals (Eq 4.3)."""
    direction = exact_weights(angle)
    return direction.env * row["r_env"] + direction.social * row["r_social"]


def _points(rows: Sequence[Row]) -> np.ndarray:
    """Return the mean totals of policies, (policy, 2)."""
    return np.array([(row["r_env"], row["r_social"]) for row in rows])


def _families(config: Config, policies: Sequence[Row]) -> list[Row]:
    """Return hypervolume, regrets at the key angles and monotony of each family and seed."""
    corner = _points(policies).min(axis=0)
    found: list[Row] = []
    for family, seed in itertools.product((DIALS, AGENTS), config.seeds):
        rows = matching(policies, family=family, seed=seed)
        rows.sort(key=lambda row: row["asked"])
        key = [row for row in rows if row["asked"] in config.key_angles]
        regrets = {f"regret_{row['asked']:g}": row["regret"] for row in key}
        turns = np.diff(_points(rows), axis=0)
        found.append(
            {
                "family": family,
                "seed": seed,
                "hypervolume": hypervolume(_points(key), corner),
                "mean_regret": float(np.mean(list(regrets.values()))),
                "worst_regret": max(regrets.values()),
                **regrets,
                "angles": len(rows),
                "rise_r_env": float(max(turns[:, 0].max(), 0.0)),
                "drop_r_social": float(max(-turns[:, 1].min(), 0.0)),
                "most_arrivals": max(row["arrival"] for row in rows),
            }
        )
    return found


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


def draw(results: Results) -> dict[str, Figure]:
    """Draw all figures of the study."""
    return {
        "tradeoff": _tradeoff(results),
        "regret": _regret(results),
        "turning": _turning(results),
        "learning": _learning(results),
    }


def _tradeoff(results: Results) -> Figure:
    """Draw mean totals of every policy; a dial's are joined in the order in which it turns."""
    drawn = figure(7.5, 5.2)
    axes = drawn.subplots()
    for family, (color, mark, label) in _LOOKS.items():
        style: dict[str, Any] = {"linestyle": "-" if family == DIALS else "none"}
        style |= {"marker": mark, "color": color, "linewidth": 0.6, "markersize": 5, "alpha": 0.6}
        for number, seed in enumerate(results.config["seeds"]):
            rows = matching(results.tables["policies"], family=family, seed=seed)
            named = label if number == 0 else None
            line(axes, rows, "r_env", "r_social", **style, label=named)
    labels = {"xlabel": "mean total r_env of an episode"}
    labels["ylabel"] = "mean total r_social of an episode"
    finish(axes, "Turning from 0° (right) to 90° (left), all seeds", 9, **labels)
    return drawn


def _regret(results: Results) -> Figure:
    """Draw regret against the best policy of all at each key angle."""
    drawn = figure(7.0, 4.2)
    axes = drawn.subplots()
    for family, (color, mark, label) in _LOOKS.items():
        rows = matching(results.tables["policies"], family=family)
        band(axes, rows, "asked", "regret", color=color, marker=mark, label=label)
    labels = {"xlabel": "angle asked for, degrees", "ylabel": "regret against the best of all"}
    finish(axes, "Mean over seeds, band from least to largest", 9, **labels)
    return drawn


def _turning(results: Results) -> Figure:
    """Draw the endings of the dial's episodes at each angle."""
    drawn = figure(7.0, 4.2)
    axes = drawn.subplots()
    rows = matching(results.tables["policies"], family=DIALS)
    for name, color in _RATES.items():
        band(axes, rows, "asked", name, 100.0, color=color, marker="o", label=name)
    title = "One dial, turned: mean over seeds, band from least to largest"
    labels = {"xlabel": "angle asked for, degrees", "ylabel": "episodes, %"}
    finish(axes, title, 9, **labels, ylim=(0, 100))
    return drawn


def _learning(results: Results) -> Figure:
    """Draw J(α) of each run while it trains: the mean over the angles of its checks."""
    drawn = figure(8.0, 4.2)
    axes = drawn.subplots()
    for (run,), rows in groups(results.tables["curves"], "run").items():
        color, *_ = _LOOKS[DIALS if run.startswith("dials") else AGENTS]
        line(axes, rows, "updates", "total", color=color, linewidth=0.9, alpha=0.6)
    title = "Blue: dials. Red: agents, each at its own angle"
    finish(axes, title, xlabel="updates", ylabel="J(α): a dial's mean over 0°, 45°, 90°")
    return drawn


STUDY = Study(
    name="intersection-dial",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "families",
        "family",
        "seed",
        "hypervolume",
        "mean_regret",
        "worst_regret",
        "rise_r_env",
        "drop_r_social",
        "most_arrivals",
        title="regret against the best policy of all, over the key angles",
    ),
)
