"""Study `mujoco-imitation`: imitation of trained experts on MuJoCo, beside cloning."""

import json
from collections.abc import Sequence

import numpy as np

from socialiq.types import Row
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, matching, nested, paired_row, with_holm
from studies.mujoco_imitation import plan
from studies.mujoco_imitation.plan import ABLATED, Config, Pieces, jobs
from studies.mujoco_imitation.runs import METHODS, POLICY, RECORD, TASKS, VARIANTS

__all__ = ["Config", "compute_tables", "jobs"]


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the pieces: those that were there, and the new ones."""
    pieces = plan.committed(config.pieces)
    for job in context.jobs:
        folder = context.work / job.name
        if job.stage == "expert":
            for name in (POLICY, RECORD):
                pieces[f"{job.config.task}_{name}"] = (folder / name).read_bytes()
        if job.stage == "runs":
            run = job.config
            for seed in run.seeds:
                name = plan.name_of(run.task, run.method, run.trajectories, seed)
                pieces[name] = (folder / f"{seed}.json").read_bytes()
    experts = expert_rows(pieces)
    runs = run_rows(pieces, experts)
    tests = []  # IQ-Learn's share against that of cloning, paired over seeds
    for task, count in dict.fromkeys((row["task"], row["trajectories"]) for row in runs):
        label = {"task": task, "trajectories": count}
        for name, method in METHODS.items():
            if method.clone:
                tests += _paired(label, matching(runs, **label), name, method.clone)
    cells = []
    for task, method, count in plan.cells(config):
        if method in METHODS:
            label = {"task": task, "trajectories": count, "method": method}
            cell = matching(runs, **label)
            online = count == 1 and METHODS[method].online
            published = {"published": TASKS[task].published if online else ""}
            cells.append(label | {"runs": len(cell)} | _pooled(cell) | published)
    ablated = matching(runs, task=ABLATED[0], trajectories=ABLATED[1])
    varied = any(row["method"] in VARIANTS for row in ablated)
    tables = {
        "cells": cells,
        "experts": experts,
        "runs": runs,
        "differences": with_holm(tests),
        "ablations": [
            {"method": name, "runs": len(of_method)} | _pooled(of_method)
            for name in ("online", *VARIANTS)
            if varied and (of_method := matching(ablated, method=name))
        ],
        "ablation_differences": ablation_difference_rows(ablated),
    }
    summary = nested(tables["cells"], "task", "trajectories", "method")
    summary |= {"experts": nested(experts, "task")}
    return Findings(tables, summary, {f"{plan.FOLDER}/{name}": pieces[name] for name in pieces})


def _of_returns(returns: Sequence[float]) -> Row:
    """Return the mean, the least and the greatest of the returns of episodes."""
    array = np.array(returns)
    extremes = {"least_return": float(array.min()), "greatest_return": float(array.max())}
    return {"mean_return": float(array.mean())} | extremes


def expert_rows(pieces: Pieces) -> list[Row]:
    """Return each expert's return, in the order of `TASKS`."""
    rows = []
    for task in TASKS:
        if expert := plan.expert_of(pieces, task):
            record = json.loads(expert[RECORD])
            best = max(record["checkpoints"], key=lambda checkpoint: checkpoint["mean_return"])
            label = {"task": task} | {key: record["recipe"][key] for key in ("seed", "updates")}
            label |= {"best_checkpoint": best["updates"], "episodes": len(record["returns"])}
            rows.append(label | _of_returns(record["returns"]))
    return rows


def run_rows(pieces: Pieces, experts: Sequence[Row]) -> list[Row]:
    """Return each run with its share of the expert's return."""
    expert_returns = {row["task"]: row["mean_return"] for row in experts}
    order = {name: number for number, name in enumerate((*TASKS, *METHODS, *VARIANTS))}
    records = [json.loads(pieces[name]) for name in pieces if "_expert." not in name]
    records = [piece for piece in records if piece["task"] in expert_returns]
    names = ("task", "trajectories", "method", "seed", "updates")
    records.sort(key=lambda piece: [order.get(piece[name], piece[name]) for name in names[:4]])
    rows = []
    for piece in records:
        row = {name: piece[name] for name in names} | _of_returns(piece["returns"])
        row["demonstrated_return"] = piece["demonstrated_return"]
        rows.append(row | {"share": row["mean_return"] / expert_returns[row["task"]]})
    return rows


def _pooled(runs: Sequence[Row]) -> Row:
    names = ("mean_return", "least_run", "share", "least_share")
    if not runs:
        return dict.fromkeys(names, "")
    returned, share = column(runs, "mean_return"), column(runs, "share")
    values = (np.mean(returned), min(returned), np.mean(share), min(share))
    return dict(zip(names, map(float, values), strict=True))


def ablation_difference_rows(ablated: Sequence[Row]) -> list[Row]:
    """Test each variant's share against that of no change, paired over seeds, Holm over all."""
    return with_holm([row for name in VARIANTS for row in _paired({}, ablated, name, "online")])


def _paired(label: Row, cell: Sequence[Row], first: str, second: str) -> list[Row]:
    """Return the test of a method's share against another's; none below two seeds with both."""
    cells = [matching(cell, method=method) for method in (first, second)]
    shares = [{row["seed"]: row["share"] for row in rows} for rows in cells]
    seeds = sorted(shares[0].keys() & shares[1].keys())
    if len(seeds) < 2:
        return []
    sides = ([of_seed[seed] for seed in seeds] for of_seed in shares)
    return [paired_row(label | {"first": first, "second": second}, *sides)]
