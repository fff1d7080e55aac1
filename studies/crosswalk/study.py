"""Optima and dials of the 7x7 world with a crosswalk, over the social and the class angle."""

from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.classes import ClassGround
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import PRESETS
from socialiq.storage import write_atomically
from socialiq.types import Row
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq_lab.gridworld_runs import file_of, train_dials
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.study import Context, Findings

SUMS = ("r_env", "r_vehicle", "r_vulnerable")
DIAL = "dial.safetensors"
"""File of the first seed's dial in the results folder: chosen before any was evaluated."""


def jobs(config: Any) -> list[Job]:
    """Return the job that trains the dials, and that of the exact optima."""
    work = {"dials": trained_dials, "optima": exact_optima}
    return [Job(f"crosswalk/{name}", work[name], Part(config)) for name in work]


def _ground() -> ClassGround:
    return ClassGround(tabulate(make_grid("crosswalk7").with_clock()))


@keeps_rows
def trained_dials(part: Part, folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Train a dial of each seed, hold it against the optima, and write the first seed's."""
    config = part.study
    ground = _ground()
    world = make_grid("crosswalk7").with_clock().with_parts()
    inputs = world, config.seeds, (), config.updates, Callbacks(on_stage("dials"))
    trained = train_dials(PRESETS["online-classes"], *inputs)
    write_atomically(folder / "dial", file_of(trained.policy(0)))
    dials = list[Row]()
    directions = list[Row]()
    for run, seed in enumerate(config.seeds):
        rows = [{"seed": seed} | row for row in ground.sweep(trained.policy(run), config.every)]
        regrets = np.array([row["regret"] for row in rows])
        largest = {"collision": max(row["collision"] for row in rows)}
        means = {"mean_regret": float(regrets.mean()), "worst_regret": float(regrets.max())}
        dials.append({"seed": seed} | means | largest)
        directions += rows
    return {"directions": directions, "dials": dials}


@keeps_rows
def exact_optima(part: Part, _folder: Path, _on_stage: StageCallback) -> dict[str, list[Row]]:
    """Solve every direction, and count distinct optima and vertices."""
    config = part.study
    ground = _ground()
    fine = {tuple(round(row[name], 6) for name in SUMS) for row in ground.optima(config.fine)}
    counts = {
        "states": ground.part.mdp.n_states,
        "distinct_optima": len(fine),
        "vertices": len(ground.front().vertices) if config.front else 0,
    }
    return {"optima": list(ground.optima(config.every)), "counts": [counts]}


def compute_tables(_config: Any, context: Context) -> Findings:
    """Return what the jobs have kept.

    Args:
        context: The finished jobs.

    Returns:
        Tables `optima`, `directions` and `dials`, the summary, and the first seed's dial.
    """
    tables = context.tables()
    (summary,) = tables.pop("counts")
    summary["worst_regret"] = max(row["worst_regret"] for row in tables["dials"])
    return Findings(tables, summary, {DIAL: (context.work / "crosswalk/dials/dial").read_bytes()})
