"""Imitation of trained experts on MuJoCo, compared with cloning: plan, committed pieces, tables."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import UserError
from socialiq.demonstrations import files
from socialiq.foreign import one_line
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.storage import read_json, shipped
from socialiq.types import Row
from socialiq_lab.comparison import as_file_name, check_names
from socialiq_lab.jobs import Inputs, Job, ProgressCallback
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, matching, nested, paired_row, with_holm
from studies.mujoco_imitation import runs
from studies.mujoco_imitation.runs import METHODS, POLICY, RECORD, TASKS, VARIANTS

COUNTS = (1, 5, 25)  # trajectories of a set of demonstrations, as in the tables


FOLDER = "pieces"
Pieces = dict[str, bytes]
"""Content of the files of pieces by name: the record of each run, and two files of each expert."""


def name_of(task: str, method: str, trajectories: int, seed: int) -> str:
    """Return the name of a run's file.

    Args:
        task: Name of the task.
        method: Name of the method or variant.
        trajectories: Number of demonstrated trajectories.
        seed: Training seed.
    """
    return f"{task}-{as_file_name(method)}-{trajectories}-{seed}.json"


def expert_of(pieces: Pieces, task: str) -> Pieces:
    """Return the files of a task's expert by their name in its job.

    Args:
        pieces: Content of the files of pieces by name.
        task: Name of the task.

    Returns:
        Content of record and policy; empty without an expert.
    """
    names = {name: f"{task}_{name}" for name in (RECORD, POLICY)}
    return {name: pieces[file] for name, file in names.items() if file in pieces}


def committed(folder: str) -> Pieces:
    """Read the pieces of a results folder; none if no folder is named."""
    if not folder:
        return {}
    source = shipped(Path(folder)) / FOLDER
    if not source.is_dir():
        raise UserError(f"{folder} holds no pieces: name a results folder of this study")
    pieces: Pieces = {}
    for path in sorted(source.glob("*.json")):
        record = read_json(path)
        if path.name.endswith(f"_{RECORD}"):
            policy = path.with_name(path.name.replace(RECORD, POLICY))
            if not policy.is_file():
                raise UserError(f"{policy} is missing: restore it, or leave out {path.name}")
            pieces |= {path.name: path.read_bytes(), policy.name: policy.read_bytes()}
            continue
        try:
            key = [record[name] for name in ("task", "method", "trajectories", "seed")]
            is_known = key[0] in TASKS and key[1] in runs.RECIPES
            pieces[name_of(*key)] = path.read_bytes()
        except (KeyError, TypeError) as error:
            raise UserError(f"{path} is damaged: restore it or make it again") from error
        if not is_known:
            what = one_line(f"{key[1]} on {key[0]}")
            raise UserError(
                f"{path} is of {what}, which is unknown here: remove it, or update socialiq"
            )
    return pieces


ABLATED = ("Hopper", 5)  # task and number of trajectories of the ablations


@dataclass(frozen=True)
class Showing:
    """Trajectories of an expert, a new one or one of a results folder: a set of one seed."""

    task: str
    trajectories: int
    seed: int
    pieces: str = ""
    sha256: str = ""


def show(showing: Showing, folder: Path, inputs: Inputs, progress: ProgressCallback) -> None:
    """Write whole trajectories of the expert's mean actions.

    Args:
        showing: Task, number of trajectories, their first seed, and the folder of a committed
            expert.
        folder: Folder of the job, to which the trajectories are written.
        inputs: Folder of the job that trained a new expert; empty for a committed one.
        progress: Callback of the finished share, 0 to 1.

    Raises:
        UserError: If the committed expert has changed since the jobs were planned.
    """
    if showing.pieces:
        if _sha256(committed(showing.pieces), showing.task) != showing.sha256:
            raise UserError(
                f"{showing.pieces} has changed since the study began: give the command again"
            )
        expert = shipped(Path(showing.pieces)) / FOLDER / f"{showing.task}_{POLICY}"
    else:
        expert = next(iter(inputs.values())) / POLICY
    policy = ActorPolicy.load(expert)
    episodes = runs.played(TASKS[showing.task], policy, showing.trajectories, showing.seed)
    files.save(folder / runs.SHOWN, episodes)
    progress(1.0)


def _sha256(pieces: Pieces, task: str) -> str:
    expert = expert_of(pieces, task)
    return hashlib.sha256(b"".join(expert[name] for name in sorted(expert))).hexdigest()


def cells(config: Any) -> Iterator[tuple[str, str, int]]:
    """Yield task, method and number of trajectories of each cell of the plan."""
    for task, count, method in product(config.tasks, config.trajectories, config.methods):
        if METHODS[method].forces or TASKS[task].forces:
            yield task, method, count
    task, count = ABLATED
    if config.ablate and task in config.tasks and count in config.trajectories:
        for variant in config.variants:
            yield task, variant, count


def jobs(config: Any) -> list[Job]:
    """Return `plan`, after a check that MuJoCo is installed."""
    if planned := plan(config):
        runs.make_env(TASKS[config.tasks[0]]).close()
    return planned


def plan(config: Any) -> list[Job]:
    """Return the jobs of what is missing, each after its inputs."""
    for count in config.trajectories:
        if not 1 <= count <= max(COUNTS):
            raise UserError(f"trajectories must be 1 to {max(COUNTS)}, got {count}")
    check_names(config, tasks=TASKS, methods=METHODS, variants=VARIANTS)
    there = committed(config.pieces)
    planned = list[Job]()
    for task in config.tasks if config.new else ():
        missing: dict[tuple[str, int], tuple[int, ...]] = {}
        for of_task, method, count in cells(config):
            seeds = tuple(s for s in config.seeds if name_of(task, method, count, s) not in there)
            if of_task == task and seeds:
                missing[method, count] = seeds
        source = config.pieces, _sha256(there, task)
        inputs = ()
        if not expert_of(there, task):
            settings = TASKS[task].expert
            recipe = runs.Expert(
                task=task,
                seed=config.expert_seed,
                settings=replace(settings, updates=config.expert_updates or settings.updates),
                every=config.every,
                judged=config.judged,
                judging_seed=config.judging_seed,
                episodes=config.expert_episodes,
                evaluation_seed=config.evaluation_seed,
            )
            planned.append(Job(f"expert/{task}", runs.train_expert, recipe, cost=300.0))
            source = ()
            inputs = (f"expert/{task}",)
        for seed in sorted({seed for seeds in missing.values() for seed in seeds}):
            first = config.data_seed + max(COUNTS) * seed
            showing = Showing(task, max(config.trajectories), first, *source)
            planned.append(Job(f"shown/{task}-{seed}", show, showing, inputs, cost=5.0))
        for (method, count), seeds in missing.items():
            evaluation = config.updates, config.episodes, config.evaluation_seed
            run = runs.Imitation(task, method, count, seeds, *evaluation)
            sets = tuple(f"shown/{task}-{seed}" for seed in seeds)
            cost = len(seeds) * (90.0 if runs.RECIPES[method].online else 15.0)
            name = "runs/" + name_of(task, method, count, seeds[0]).removesuffix(".json")
            planned.append(Job(name, runs.imitate, run, sets, cost=cost))
    return planned


def compute_tables(config: Any, context: Context) -> Findings:
    """Compute every table from the pieces: the committed ones, and the new ones.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        All tables, the pooled cells and the experts as summary, and the files of all pieces.
    """
    pieces = committed(config.pieces)
    for job in context.jobs:
        folder = context.work / job.name
        if job.stage == "expert":
            for name in (POLICY, RECORD):
                pieces[f"{job.config.task}_{name}"] = (folder / name).read_bytes()
        if job.stage == "runs":
            run = job.config
            for seed in run.seeds:
                name = name_of(run.task, run.method, run.trajectories, seed)
                pieces[name] = (folder / f"{seed}.json").read_bytes()
    experts = expert_rows(pieces)
    rows = run_rows(pieces, experts)
    tests = []  # IQ-Learn's share against that of cloning, paired over seeds
    for task, count in dict.fromkeys((row["task"], row["trajectories"]) for row in rows):
        label = {"task": task, "trajectories": count}
        for name, method in METHODS.items():
            if method.clone:
                tests += _paired(label, matching(rows, **label), name, method.clone)
    pooled = []
    for task, method, count in cells(config):
        if method in METHODS:
            label = {"task": task, "trajectories": count, "method": method}
            cell = matching(rows, **label)
            online = count == 1 and METHODS[method].online
            published = {"published": TASKS[task].published if online else ""}
            pooled.append(label | {"runs": len(cell)} | _pooled(cell) | published)
    ablated = matching(rows, task=ABLATED[0], trajectories=ABLATED[1])
    varied = any(row["method"] in VARIANTS for row in ablated)
    tables = {
        "cells": pooled,
        "experts": experts,
        "runs": rows,
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
    return Findings(tables, summary, {f"{FOLDER}/{name}": pieces[name] for name in pieces})


def _of_returns(returns: Sequence[float]) -> Row:
    """Return the mean, the least and the greatest of the returns of episodes."""
    array = np.array(returns)
    extremes = {"least_return": float(array.min()), "greatest_return": float(array.max())}
    return {"mean_return": float(array.mean())} | extremes


def expert_rows(pieces: Pieces) -> list[Row]:
    """Return each expert's return, in the order of `TASKS`."""
    rows = []
    for task in TASKS:
        if expert := expert_of(pieces, task):
            record = json.loads(expert[RECORD])
            best = max(record["checkpoints"], key=lambda checkpoint: checkpoint["mean_return"])
            label = {"task": task} | {key: record["recipe"][key] for key in ("seed", "updates")}
            label |= {"best_checkpoint": best["updates"], "episodes": len(record["returns"])}
            rows.append(label | _of_returns(record["returns"]))
    return rows


def run_rows(pieces: Pieces, experts: Sequence[Row]) -> list[Row]:
    """Return each run with its share of the expert's return.

    Args:
        pieces: Content of the files of pieces by name.
        experts: Rows of `expert_rows`; runs of further tasks are left out.

    Returns:
        Rows by task, number of trajectories, method and seed.
    """
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
    returned = column(runs, "mean_return")
    share = column(runs, "share")
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
