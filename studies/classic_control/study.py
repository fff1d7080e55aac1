"""IQ-Learn on classic control from few transitions, an outside check of the learner.

The IQ-Learn paper (Garg et al. 2021, Fig 2) learns CartPole offline from every 20th transition of
one trajectory. Its experts are not public; these are hand-written, of several trajectories.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq import UserError
from socialiq.learners.settings import check_counts
from socialiq.storage import read_json
from socialiq.types import Row
from socialiq_lab.comparison import as_file_name, check_names
from socialiq_lab.jobs import Job
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, groups, matching, nested, paired_row, with_holm
from studies.classic_control import runs
from studies.classic_control.runs import METHODS, PROTOCOLS, PUBLISHED, VARIANTS, Source
from studies.classic_control.tasks import TASKS, make_env

SOLVED = 475.0  # mean return at which Gymnasium calls CartPole-v1 solved

PAIRS = declaration("classic-control")["pairs"]
"""Methods that are compared, with the same demonstrations."""

KEYS = ("task", "protocol", "trajectories")  # columns that name a source of demonstrations


def sources_of(config: Any, task: str) -> list[Source]:
    """Return the sources of demonstrations of a task."""
    seeds = config.episodes, config.evaluation_seed
    if TASKS[task].env != "CartPole-v1":
        kinds = [("rows", count, config.other_sets) for count in config.other_trajectories]
    elif task != "CartPole":
        kinds = [("rows", 1, config.sets)]
    else:
        counts: dict[str, Any] = dict.fromkeys(config.protocols, config.protocol_trajectories)
        counts |= {"rows": config.trajectories}
        kinds = [
            (protocol, count, config.sets)
            for protocol in config.protocols
            for count in counts[protocol]
        ]
    return [Source(task, *kind, config.data_seed, *seeds) for kind in kinds]


def jobs(config: Any) -> list[Job]:
    """Return `plan`, once every task's library is known to be there."""
    planned = plan(config)
    for task in config.tasks:
        make_env(TASKS[task]).close()
    return planned


def plan(config: Any) -> list[Job]:
    """Return every job; none reads another."""
    check_counts(config, ("sets", "other_sets", "episodes"))
    counts = (*config.trajectories, *config.protocol_trajectories, *config.other_trajectories)
    if min((*counts, 1)) < 1:
        raise UserError("trajectories must be at least 1")
    choices = {"tasks": TASKS, "protocols": PROTOCOLS, "methods": METHODS}
    check_names(config, **choices, published=PUBLISHED, variants=VARIANTS)

    def training(source: Source, method: str, name: str) -> Job:
        run = runs.Training(source, method, config.seeds, config.updates)
        cost = 40.0 if "online" in method else 20.0
        return Job(f"{name}/{as_file_name(method)}", runs.train_and_score, run, cost=cost)

    planned: list[Job] = []
    for task in config.tasks:
        for source in sources_of(config, task):
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


def compute_tables(config: Any, context: Context) -> Findings:
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
