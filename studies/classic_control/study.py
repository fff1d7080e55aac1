"""IQ-Learn on classic control from few transitions, an outside check of the learner.

The IQ-Learn paper (Garg et al. 2021, Fig 2) learns CartPole offline from every 20th transition of
one trajectory. Its experts are not public; these are hand-written, of several trajectories.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq import UserError
from socialiq.learners.settings import check_counts
from socialiq.storage import read_json
from socialiq.types import Row
from socialiq_lab.comparison import as_file_name, check_names
from socialiq_lab.jobs import Job
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, groups, matching, nested, paired_row, with_holm
from studies.classic_control import runs
from studies.classic_control.runs import METHODS, PROTOCOLS, PUBLISHED, VARIANTS, Source
from studies.classic_control.tasks import TASKS, make_env

SOLVED = 475.0  # mean return at which Gymnasium calls CartPole-v1 solved

PAIRS = (
    ("iq_learn", "cloning"),
    ("iq_learn, mirrored", "cloning, mirrored"),
    ("iq_learn online", "cloning"),
)
"""Methods that are compared, with the same demonstrations."""

KEYS = ("task", "protocol", "trajectories")  # columns that name a source of demonstrations


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12)  # training seeds; 100 to 102 were used in development
    tasks: tuple[str, ...] = tuple(TASKS)  # names of `TASKS`; LunarLander needs the extra box2d
    protocols: tuple[str, ...] = PROTOCOLS
    """Rows kept of a trajectory of CartPole; of the other tasks always one of each block."""
    trajectories: tuple[int, ...] = (1, 5)
    """Trajectories of a set of demonstrations of CartPole, one row of each block."""
    protocol_trajectories: tuple[int, ...] = (1, 5)  # the same with the other protocols
    other_trajectories: tuple[int, ...] = (1, 5)  # trajectories of a set of the other environments
    methods: tuple[str, ...] = tuple(METHODS)  # names of `METHODS`
    published: tuple[str, ...] = tuple(PUBLISHED)
    """Names of `PUBLISHED`: on CartPole, one thinned trajectory."""
    variants: tuple[str, ...] = tuple(VARIANTS)
    """Names of `VARIANTS`, ablations: on CartPole, one trajectory, one row of each block."""
    sets: int = 12  # sets of demonstrations of CartPole, each of trajectories of its own
    other_sets: int = 6
    """Sets of the other environments, and first ones of CartPole's for the ablations."""
    episodes: int = 20  # evaluation episodes of each policy
    updates: int = 0  # gradient steps of each learner; 0 for those of its settings
    data_seed: int = 7_000
    """Seed of the first trajectory; 50,000,000 and later ones were used in development."""
    evaluation_seed: int = 9_000  # seed of the evaluation's first states
    shrinkages: tuple[float, ...] = (1e-4, 1e-2)  # penalties of the linear fits

    def __post_init__(self) -> None:
        """Refuse unknown names and empty sizes."""
        check_counts(self, ("sets", "other_sets", "episodes"))
        counts = (*self.trajectories, *self.protocol_trajectories, *self.other_trajectories)
        if min((*counts, 1)) < 1:
            raise UserError("trajectories must be at least 1")
        choices = {"tasks": TASKS, "protocols": PROTOCOLS, "methods": METHODS}
        check_names(self, **choices, published=PUBLISHED, variants=VARIANTS)

    def sources(self, task: str) -> list[Source]:
        """Return the sources of demonstrations of a task."""
        seeds = self.episodes, self.evaluation_seed
        if TASKS[task].env != "CartPole-v1":
            kinds = [("rows", count, self.other_sets) for count in self.other_trajectories]
        elif task != "CartPole":
            kinds = [("rows", 1, self.sets)]
        else:
            counts = dict.fromkeys(self.protocols, self.protocol_trajectories)
            counts |= {"rows": self.trajectories}
            kinds = [
                (protocol, count, self.sets)
                for protocol in self.protocols
                for count in counts[protocol]
            ]
        return [Source(task, *kind, self.data_seed, *seeds) for kind in kinds]


def jobs(config: Config) -> list[Job]:
    """Return `plan`, once every task's library is known to be there."""
    for task in config.tasks:
        make_env(TASKS[task]).close()
    return plan(config)


def plan(config: Config) -> list[Job]:
    """Return every job; none reads another."""

    def training(source: Source, method: str, name: str) -> Job:
        run = runs.Training(source, method, config.seeds, config.updates)
        cost = 40.0 if "online" in method else 20.0
        return Job(f"{name}/{as_file_name(method)}", runs.train_and_score, run, cost=cost)

    planned: list[Job] = []
    for task in config.tasks:
        for source in config.sources(task):
            name = "-".join(map(as_file_name, source.label().values()))
            inspection = runs.Inspection(source, config.shrinkages)
            planned.append(Job(f"data/{name}", runs.inspect, inspection))
            thin = (task, source.trajectories) == ("CartPole", 1) and source.protocol != "whole"
            methods = (*config.methods, *(config.published if thin else ()))
            planned += [training(source, method, f"runs/{name}") for method in methods]
    if "CartPole" in config.tasks:
        seeds = config.data_seed, config.episodes, config.evaluation_seed
        source = Source("CartPole", "rows", 1, min(config.sets, config.other_sets), *seeds)
        planned += [training(source, variant, "variants") for variant in config.variants]
    return planned


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    rows: dict[str, list[Row]] = {"data": [], "runs": [], "variants": []}
    for job in context.jobs:
        rows[job.stage] += read_json(context.work / job.name / runs.ROWS)
    policies, variants = rows["runs"], rows["variants"]
    # The criterion knows the expert's class and no learner: where the linear fit with the least
    # penalty solves CartPole, a set's rows identify the expert.
    fit = f"linear_{min(config.shrinkages, default=0.0):g}"
    told = [_set_of(row) for row in rows["data"] if row.get(fit, 0.0) >= SOLVED]
    # Ablations are compared with their methods on the same sets.
    sets = set(column(variants, "set"))
    unchanged = [
        row
        for row in matching(policies, task="CartPole", protocol="rows", trajectories=1)
        if row["method"] in runs.VARIED and row["set"] in sets
    ]
    keys = (*KEYS, "method")
    tables = {
        "data": rows["data"],
        "returns": policies,
        "pooled": pooled(policies, *keys),
        "identified": pooled([row for row in policies if _set_of(row) in told], *keys),
        "differences": differences(policies),
        "ablations": pooled([*unchanged, *variants], "method"),
        "ablation_returns": variants,
    }
    names = ("mean", "worst", "solved", "ensemble_mean")
    summary = nested(tables["pooled"], *keys, keep=names)
    for row in tables["identified"]:
        level = summary
        for key in keys:
            level = level[str(row[key])]
        level["identified"] = {name: row[name] for name in ("mean", "worst", "policies")}
    for (task,), group in groups(tables["data"], "task").items():
        summary[task]["expert"] = float(np.mean(column(group, "expert_return")))
    return Findings(tables, summary)


def _set_of(row: Row) -> tuple[Any, ...]:
    return tuple(row[key] for key in (*KEYS, "set"))


def pooled(rows: Sequence[Row], *keys: str) -> list[Row]:
    """Return mean, worst and spread over sets and seeds, and those of the sets' ensembles."""
    means = []
    for values, group in groups(rows, *keys).items():
        single = [row for row in group if row["seed"] != "ensemble"]
        joint = column(matching(group, seed="ensemble"), "mean_return")
        returns = np.array(column(single, "mean_return"))
        of_sets = list(_set_means(single).values())
        entry: Row = dict(zip(keys, values, strict=True)) | {"policies": len(returns)}
        entry |= {"mean": float(returns.mean())}
        entry |= {"deviation_of_sets": float(np.std(of_sets, ddof=1)) if len(of_sets) > 1 else 0.0}
        entry |= {"worst": float(returns.min()), "best": float(returns.max())}
        entry |= {"solved": float((returns >= SOLVED).mean())}
        entry |= {"ensemble_mean": float(np.mean(joint)), "ensemble_worst": float(min(joint))}
        means.append(entry)
    return means


def _set_means(rows: Sequence[Row]) -> dict[Any, float]:
    """Return the mean return of the single policies of each set."""
    single = groups([row for row in rows if row["seed"] != "ensemble"], "set")
    return {key: float(np.mean(column(group, "mean_return"))) for key, group in single.items()}


def differences(rows: Sequence[Row]) -> list[Row]:
    """Test the pairs of methods, paired over sets of demonstrations; Holm over all."""
    tests = []
    for values, group in groups(rows, *KEYS).items():
        for first, second in PAIRS:
            sides = [_set_means(matching(group, method=name)) for name in (first, second)]
            if min(map(len, sides)) > 1:
                label = dict(zip(KEYS, values, strict=True)) | {"first": first, "second": second}
                tests.append(paired_row(label, *([of[key] for key in sorted(of)] for of in sides)))
    return with_holm(tests)
