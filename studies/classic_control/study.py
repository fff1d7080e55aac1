"""IQ-Learn on classic control from few transitions, an outside check of the learner.

This is not a claim of the thesis. The IQ-Learn paper (Garg et al. 2021, Fig 2) learns CartPole
offline from every 20th transition of one expert trajectory. The paper's expert files are no longer
public, so the experts here are hand-written controllers (`tasks`). What is learned depends on the
trajectory, so that everything is repeated over several.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.errors import UserError, one_of
from socialiq.learners.settings import check_counts
from socialiq.plotting.style import figure, plain
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq_lab.jobs import Job
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import column, groups, matching, nested, paired_row, with_holm
from studies.classic_control.methods import METHODS, PUBLISHED, VARIANTS
from studies.classic_control.runs import (
    PROTOCOLS,
    Inspection,
    Source,
    Training,
    inspect,
    read_rows,
    train_and_score,
)
from studies.classic_control.tasks import TASKS, make_env

_COLORS = ("#7f7f7f", "#2166ac", "#e08214", "#053061", "#7f3b08", "#bdbdbd", "#1b7837", "#00441b")


def draw(results: Results) -> dict[str, Figure]:
    """Draw the return of each policy, by method, in a panel for each kind of data."""
    panels = groups(results.tables["returns"], "task", "protocol", "trajectories")
    columns = 2
    lines = -(-len(panels) // columns)
    picture = figure(9.6, 3.0 * lines)
    for index, (label, rows) in enumerate(panels.items(), start=1):
        axes = picture.add_subplot(lines, columns, index)
        methods = list(dict.fromkeys(column(rows, "method")))
        for number, method in enumerate(methods):
            single = [row for row in matching(rows, method=method) if row["seed"] != "ensemble"]
            values = column(single, "mean_return")
            color = _COLORS[number % len(_COLORS)]
            axes.plot(values, [number] * len(values), "o", color=color, alpha=0.4, markersize=4)
            axes.plot([sum(values) / len(values)], [number], "|", color=color, markersize=16)
        axes.set_yticks(range(len(methods)), methods, fontsize=7)
        axes.invert_yaxis()
        count = "1 trajectory" if label[2] == 1 else f"{label[2]} trajectories"
        axes.set_title(f"{label[0]}, {label[1]}, {count}", fontsize=9)
        axes.set_xlabel("mean return", fontsize=8)
        plain(axes)
    return {"returns": picture}


def views(results: Results) -> Sequence[View]:
    """Return the tables to print."""
    tables = results.tables
    views = [View(_narrow(tables["pooled"]), "Over all sets of demonstrations and seeds")]
    if "differences" in tables:
        views.append(View(tables["differences"], "Pairs of methods, over sets of demonstrations"))
    if "ablation_returns" in tables:
        views.append(
            View(_narrow(tables["ablations"]), "CartPole, one row of each block, one changed")
        )
    return views


def _narrow(rows: Sequence[dict]) -> list[dict]:
    hidden = ("best", "deviation_of_sets")
    return [{name: value for name, value in row.items() if name not in hidden} for row in rows]


SOLVED = 475.0
"""Mean return at which Gymnasium calls CartPole-v1 solved."""

PAIRS = (
    ("iq_learn", "cloning"),
    ("iq_learn, mirrored", "cloning, mirrored"),
    ("iq_learn online", "cloning"),
)
"""Methods that are compared, with the same demonstrations."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12)
    """Training seeds; 100 to 102 were used in development."""
    tasks: tuple[str, ...] = tuple(TASKS)
    """Names of `TASKS`; LunarLander needs the extra box2d."""
    protocols: tuple[str, ...] = PROTOCOLS
    """Rows kept of a trajectory of CartPole; of the other tasks always one of each block."""
    trajectories: tuple[int, ...] = (1, 5)
    """Trajectories of a set of demonstrations of CartPole, one row of each block."""
    protocol_trajectories: tuple[int, ...] = (1, 5)
    """The same with the other protocols."""
    other_trajectories: tuple[int, ...] = (1, 5)
    """Trajectories of a set of the other environments."""
    methods: tuple[str, ...] = tuple(METHODS)
    """Names of `METHODS`."""
    published: tuple[str, ...] = tuple(PUBLISHED)
    """Names of `PUBLISHED`: on CartPole, one thinned trajectory."""
    variants: tuple[str, ...] = tuple(VARIANTS)
    """Names of `VARIANTS`, ablations: on CartPole, one trajectory, one row of each block."""
    sets: int = 12
    """Sets of demonstrations of CartPole, each of trajectories of its own."""
    other_sets: int = 6
    """Sets of the other environments, and first ones of CartPole's for the ablations."""
    episodes: int = 20
    """Evaluation episodes of each policy."""
    updates: int = 0
    """Gradient steps of each learner; 0 for those of its settings."""
    data_seed: int = 7_000
    """Seed of the first trajectory; 50,000,000 and later ones were used in development."""
    evaluation_seed: int = 9_000
    """Seed of the evaluation's first states."""
    shrinkages: tuple[float, ...] = (1e-4, 1e-2)
    """Penalties of the linear fits."""

    def __post_init__(self) -> None:
        """Refuse unknown names and empty sizes."""
        check_counts(self, ("sets", "other_sets", "episodes"))
        counts = (*self.trajectories, *self.protocol_trajectories, *self.other_trajectories)
        if min((*counts, 1)) < 1:
            raise UserError("trajectories must be at least 1")
        for what, names, choices in (
            ("task", self.tasks, TASKS),
            ("protocol", self.protocols, PROTOCOLS),
            ("method", self.methods, METHODS),
            ("published method", self.published, PUBLISHED),
            ("variant", self.variants, VARIANTS),
        ):
            for name in names:
                one_of(what, name, tuple(choices))


def plan(config: Config) -> list[Job]:
    """Return every job; none reads another."""
    return list(_jobs(config))


def _plan(config: Config) -> list[Job]:
    """Return `plan`, once every task's library is known to be there."""
    for task in config.tasks:
        make_env(TASKS[task]).close()
    return plan(config)


def _jobs(config: Config) -> Iterator[Job]:
    for task in config.tasks:
        for source in _sources(config, task):
            name = "-".join(_folder(label) for label in source.label().values())
            yield Job(f"data/{name}", inspect, Inspection(source, config.shrinkages))
            thin = (task, source.trajectories) == ("CartPole", 1) and source.protocol != "whole"
            for method in (*config.methods, *(config.published if thin else ())):
                yield _training(config, source, method, f"runs/{name}/{_folder(method)}")
    if "CartPole" in config.tasks:
        source = _source(config, "CartPole", "rows", 1, min(config.sets, config.other_sets))
        for variant in config.variants:
            yield _training(config, source, variant, f"variants/{_folder(variant)}")


def _training(config: Config, source: Source, method: str, name: str) -> Job:
    cost = 40.0 if "online" in method else 20.0
    run = Training(source, method, config.seeds, config.updates)
    return Job(name, train_and_score, run, cost=cost)


def _folder(label: Any) -> str:
    """Return a name as that of a folder."""
    return "".join(letter if letter.isalnum() else "_" for letter in str(label))


def _sources(config: Config, task: str) -> list[Source]:
    if TASKS[task].env != "CartPole-v1":
        return [
            _source(config, task, "rows", count, config.other_sets)
            for count in config.other_trajectories
        ]
    if task != "CartPole":
        return [_source(config, task, "rows", 1, config.sets)]
    return [
        _source(config, task, protocol, count, config.sets)
        for protocol in config.protocols
        for count in (config.trajectories if protocol == "rows" else config.protocol_trajectories)
    ]


def _source(config: Config, task: str, protocol: str, count: int, sets: int) -> Source:
    seeds = (config.data_seed, config.episodes, config.evaluation_seed)
    return Source(task, protocol, count, sets, *seeds)


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    rows = {
        stage: _read(context.jobs, context.work, stage) for stage in ("data", "runs", "variants")
    }
    policies = rows["runs"]
    keys = ("task", "protocol", "trajectories", "method")
    told = _identified(config, rows["data"])
    tables = {
        "data": rows["data"],
        "returns": policies,
        "pooled": _pooled(policies, *keys),
        "identified": _pooled([row for row in policies if _source_of(row) in told], *keys),
        "differences": _differences(policies),
        "ablations": _pooled([*_base(policies, rows["variants"]), *rows["variants"]], "method"),
        "ablation_returns": rows["variants"],
    }
    return Findings(tables, _summary(tables))


def _read(jobs: Sequence[Job], work: Path, stage: str) -> list[Row]:
    return [row for job in jobs if job.stage == stage for row in read_rows(work / job.name)]


def _source_of(row: Row) -> tuple[Any, ...]:
    return tuple(row[key] for key in ("task", "protocol", "trajectories", "set"))


def _identified(config: Config, rows: Sequence[Row]) -> set[tuple[Any, ...]]:
    """Return the sets whose linear fit with the least penalty solves CartPole.

    The criterion knows the expert's class and no learner: these rows identify the expert.
    """
    fit = f"linear_{min(config.shrinkages, default=0.0):g}"
    return {_source_of(row) for row in rows if row.get(fit, 0.0) >= SOLVED}


def _base(policies: Sequence[Row], variants: Sequence[Row]) -> list[Row]:
    """Return the rows that the ablations are compared with: of the same sets."""
    rows = matching(policies, task="CartPole", protocol="rows", trajectories=1)
    changed, sets = {variant.of for variant in VARIANTS.values()}, set(column(variants, "set"))
    return [row for row in rows if row["method"] in changed and row["set"] in sets]


def _pooled(rows: Sequence[Row], *keys: str) -> list[Row]:
    """Return mean, worst and spread over sets and seeds, and those of the sets' ensembles."""
    pooled = []
    for values, group in groups(rows, *keys).items():
        single = [row for row in group if row["seed"] != "ensemble"]
        joint = column(matching(group, seed="ensemble"), "mean_return")
        returns = np.array(column(single, "mean_return"))
        of_sets = [
            np.mean(column(rows_of_set, "mean_return"))
            for rows_of_set in groups(single, "set").values()
        ]
        pooled.append(
            dict(zip(keys, values, strict=True))
            | {
                "policies": len(returns),
                "mean": float(returns.mean()),
                "deviation_of_sets": float(np.std(of_sets, ddof=1)) if len(of_sets) > 1 else 0.0,
                "worst": float(returns.min()),
                "best": float(returns.max()),
                "solved": float((returns >= SOLVED).mean()),
                "ensemble_mean": float(np.mean(joint)),
                "ensemble_worst": float(min(joint)),
            }
        )
    return pooled


def _differences(rows: Sequence[Row]) -> list[Row]:
    """Test the pairs of methods, paired over sets of demonstrations; Holm over all."""
    tests = []
    for (task, protocol, count), group in groups(rows, "task", "protocol", "trajectories").items():
        for first, second in PAIRS:
            means = [_set_means(group, name) for name in (first, second)]
            if min(map(len, means)) > 1:
                label = {"task": task, "protocol": protocol, "trajectories": count}
                label |= {"first": first, "second": second}
                tests.append(paired_row(label, *means))
    return with_holm(tests)


def _set_means(rows: Sequence[Row], method: str) -> list[float]:
    single = [row for row in matching(rows, method=method) if row["seed"] != "ensemble"]
    sets = groups(single, "set")
    return [float(np.mean(column(sets[key], "mean_return"))) for key in sorted(sets)]


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Nest the pooled returns by task, protocol, trajectories and method."""
    names = ("mean", "worst", "solved", "ensemble_mean")
    keys = ("task", "protocol", "trajectories", "method")
    summary = nested(tables["pooled"], *keys, keep=names)
    for row in tables["identified"]:
        level = summary
        for key in keys:
            level = level[str(row[key])]
        level["identified"] = {
            "mean": row["mean"],
            "worst": row["worst"],
            "policies": row["policies"],
        }
    for (task,), rows in groups(tables["data"], "task").items():
        summary[task]["expert"] = float(np.mean(column(rows, "expert_return")))
    return summary


STUDY = Study(
    name="classic-control",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=views,
    jobs=_plan,
)
