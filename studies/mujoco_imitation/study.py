"""Study `mujoco-imitation`: imitation of trained experts on MuJoCo, beside cloning."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from socialiq.plotting.style import figure, plain
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import column, groups, matching, nested, paired_row, with_holm
from studies.mujoco_imitation.methods import CLONE_OF, METHODS, VARIANTS
from studies.mujoco_imitation.plan import (
    ABLATED,
    Config,
    Pieces,
    cells,
    checked_plan,
    committed,
    key_of,
)
from studies.mujoco_imitation.runs import POLICY, RECORD, row_of
from studies.mujoco_imitation.tasks import TASKS

_SHADES = (
    "#92c5de", "#4393c3", "#f4a582", "#bdbdbd", "#053061", "#7b3294", "#b2182b", "#4d4d4d",
    "#1b7837", "#7fbf7b", "#000000",
)  # fmt: skip
_COLORS = dict(zip(METHODS, _SHADES, strict=True))


def draw(results: Results) -> dict[str, Figure]:
    """Draw each run's share against the number of trajectories, in a panel for each task."""
    panels = groups(results.tables.get("runs", []), "task")
    if not panels:
        return {}
    picture = figure(3.4 * len(panels) + 1.0, 4.2)
    for index, ((task,), rows) in enumerate(panels.items(), start=1):
        axes = picture.add_subplot(1, len(panels), index)
        counts = sorted(set(column(rows, "trajectories")))
        there = [method for method in METHODS if matching(rows, method=method)]
        for shift, method in enumerate(there):
            means: list[tuple[float, float]] = []
            color = _COLORS[method]
            for number, count in enumerate(counts):
                share = column(matching(rows, method=method, trajectories=count), "share")
                x = number + 0.84 * ((shift + 0.5) / len(there) - 0.5)
                axes.plot([x] * len(share), share, "o", color=color, alpha=0.4, markersize=3)
                means += [(x, sum(share) / len(share))] if share else []
            axes.plot(*np.reshape(means, (-1, 2)).T, "_", color=color, markersize=8)
        axes.axhline(1.0, color="0.7", linewidth=0.8, zorder=0)
        axes.set_xticks(range(len(counts)), [str(count) for count in counts])
        axes.set_xlim(-0.5, len(counts) - 0.5)
        for between in range(1, len(counts)):
            axes.axvline(between - 0.5, color="0.85", linewidth=0.8, zorder=0)
        axes.set_xlabel("demonstrated trajectories")
        axes.set_ylim(bottom=min(0.0, *column(rows, "share")))
        axes.set_title(task, fontsize=9)
        plain(axes)
        if index == 1:
            axes.set_ylabel("share of the expert's return")
    names = [method for method in METHODS if matching(results.tables["runs"], method=method)]
    marks = [
        Line2D([], [], color=_COLORS[name], marker="_", linestyle="", label=name) for name in names
    ]
    picture.legend(handles=marks, frameon=False, fontsize=8, ncols=3, loc="outside lower center")
    return {"shares": picture}


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the pieces: those that were there, and the new ones."""
    pieces = gathered(committed(config.pieces), context)
    experts = expert_rows(pieces)
    runs = run_rows(pieces, experts)
    tables = {
        "cells": cell_rows(config, runs),
        "experts": experts,
        "runs": runs,
        "differences": difference_rows(runs),
        "ablations": ablation_rows(runs),
        "ablation_differences": ablation_difference_rows(runs),
    }
    summary = nested(tables["cells"], "task", "trajectories", "method")
    summary |= {"experts": nested(experts, "task")}
    return Findings(tables, summary, pieces.files())


def gathered(there: Pieces, context: Context) -> Pieces:
    """Return the pieces that were there and those that the jobs made."""
    pieces = Pieces(dict(there.experts), dict(there.runs))
    for job in context.jobs:
        folder = context.work / job.name
        if job.stage == "expert":
            files = {name: (folder / name).read_bytes() for name in (POLICY, RECORD)}
            pieces.experts[job.config.task] = files
        if job.stage == "runs":
            for seed in job.config.seeds:
                content = (folder / f"{seed}.json").read_bytes()
                pieces.runs[key_of(json.loads(content))] = content
    return pieces


def expert_rows(pieces: Pieces) -> list[Row]:
    """Return each expert's return, in the order of `TASKS`."""
    rows = []
    for task in TASKS:
        if task not in pieces.experts:
            continue
        record = json.loads(pieces.experts[task][RECORD])
        best = max(record["checkpoints"], key=lambda checkpoint: checkpoint["mean_return"])
        episode_returns = np.array(record["returns"])
        rows.append(
            {
                "task": task,
                "seed": record["recipe"]["seed"],
                "updates": record["recipe"]["updates"],
                "best_checkpoint": best["updates"],
                "episodes": len(episode_returns),
                "mean_return": float(episode_returns.mean()),
                "least_return": float(episode_returns.min()),
                "greatest_return": float(episode_returns.max()),
            }
        )
    return rows


def run_rows(pieces: Pieces, experts: Sequence[Row]) -> list[Row]:
    """Return each run with its share of the expert's return."""
    expert_returns = {row["task"]: row["mean_return"] for row in experts}
    order = {name: number for number, name in enumerate((*TASKS, *METHODS, *VARIANTS))}
    keys = [key for key in pieces.runs if key[0] in expert_returns]
    keys.sort(key=lambda key: (order[key[0]], key[2], order[key[1]], key[3]))
    rows = [row_of(json.loads(pieces.runs[key])) for key in keys]
    return [row | {"share": row["mean_return"] / expert_returns[row["task"]]} for row in rows]


def cell_rows(config: Config, runs: Sequence[Row]) -> list[Row]:
    """Return each cell of the plan, with the number of its runs and, if there are any, means."""
    rows = []
    for task, method, count in cells(config):
        if method in VARIANTS:
            continue
        runs_of_cell = matching(runs, task=task, method=method, trajectories=count)
        label = {"task": task, "trajectories": count, "method": method, "runs": len(runs_of_cell)}
        online = count == 1 and METHODS[method].online
        rows.append(
            label | _pooled(runs_of_cell) | {"published": TASKS[task].published if online else ""}
        )
    return rows


def _pooled(runs: Sequence[Row]) -> Row:
    names = ("mean_return", "least_run", "share", "least_share")
    if not runs:
        return dict.fromkeys(names, "")
    returned, share = column(runs, "mean_return"), column(runs, "share")
    values = (np.mean(returned), min(returned), np.mean(share), min(share))
    return dict(zip(names, map(float, values), strict=True))


def difference_rows(runs: Sequence[Row]) -> list[Row]:
    """Test IQ-Learn's share against that of cloning that sees the same, paired over seeds.

    Holm over all tests.
    """
    tests = []
    for task, count in dict.fromkeys((row["task"], row["trajectories"]) for row in runs):
        cell = matching(runs, task=task, trajectories=count)
        for pair in CLONE_OF.items():
            tests += _paired({"task": task, "trajectories": count}, cell, *pair)
    return with_holm(tests)


def ablation_difference_rows(runs: Sequence[Row]) -> list[Row]:
    """Test each variant's share against that of no change, paired over seeds, Holm over all."""
    task, count = ABLATED
    cell = matching(runs, task=task, trajectories=count)
    return with_holm([row for name in VARIANTS for row in _paired({}, cell, name, "online")])


def _paired(label: Row, cell: Sequence[Row], first: str, second: str) -> list[Row]:
    """Return the test of a method's share against another's; none below two seeds with both."""
    first_shares, second_shares = (
        {row["seed"]: row["share"] for row in matching(cell, method=method)}
        for method in (first, second)
    )
    seeds = sorted(set(first_shares) & set(second_shares))
    if len(seeds) < 2:
        return []
    sides = ([of[seed] for seed in seeds] for of in (first_shares, second_shares))
    return [paired_row(label | {"first": first, "second": second}, *sides)]


def ablation_rows(runs: Sequence[Row]) -> list[Row]:
    """Return the means of online imitation and of its variants, in the ablations' cell."""
    task, count = ABLATED
    cell = matching(runs, task=task, trajectories=count)
    rows = []
    for method in ("online", *VARIANTS):
        runs_of_method = matching(cell, method=method)
        if runs_of_method and (method != "online" or {row["method"] for row in cell} & {*VARIANTS}):
            rows.append({"method": method, "runs": len(runs_of_method)} | _pooled(runs_of_method))
    return rows


def views(results: Results) -> Sequence[View]:
    """Return the tables to print."""
    titles = {
        "cells": "Share of the expert's return; cells without runs are not made yet",
        "experts": "Experts",
        "differences": "IQ-Learn's share minus cloning's, over seeds",
        "ablations": f"Online, options changed: {ABLATED[0]}, {ABLATED[1]} trajectories",
        "ablation_differences": "Share with an option changed minus without, over seeds",
    }
    tables: dict[str, Any] = results.tables
    return [View(tables[name], title) for name, title in titles.items() if name in tables]


STUDY = Study(
    name="mujoco-imitation",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=views,
    jobs=checked_plan,
)
