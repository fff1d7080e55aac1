"""Optima and dials of the 7x7 world with a crosswalk, over the social and the class angle."""

from typing import Any

import numpy as np

from socialiq.evaluation.classes import ClassGround
from socialiq.learners.dial.config import PRESETS
from socialiq.types import Row
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq_lab.gridworld_runs import file_of, train_dials
from socialiq_lab.study import Context, Findings

SUMS = ("r_env", "r_vehicle", "r_vulnerable")
DIAL = "dial.safetensors"
"""File of the first seed's dial in the results folder: chosen before any was evaluated."""


def compute_tables(config: Any, context: Context) -> Findings:
    """Solve every direction, train a dial of each seed, and hold it against the optima.

    Args:
        config: Configuration of the study.
        context: Progress callback; the study has no jobs.

    Returns:
        Tables `optima`, `directions` and `dials`, the summary, and the first seed's dial.
    """
    world = make_grid("crosswalk7").with_clock()
    ground = ClassGround(tabulate(world))
    report = context.on_stage("dial of two angles")
    inputs = world.with_parts(), config.seeds, (), config.updates, report
    trained = train_dials(PRESETS["online-classes"], *inputs)
    dials = list[Row]()
    directions = list[Row]()
    for run, seed in enumerate(config.seeds):
        rows = [{"seed": seed} | row for row in ground.sweep(trained.policy(run), config.every)]
        regrets = np.array([row["regret"] for row in rows])
        largest = {"collision": max(row["collision"] for row in rows)}
        means = {"mean_regret": float(regrets.mean()), "worst_regret": float(regrets.max())}
        dials.append({"seed": seed} | means | largest)
        directions += rows
    optima = list(ground.optima(config.every))
    fine = {tuple(round(row[name], 6) for name in SUMS) for row in ground.optima(config.fine)}
    summary = {
        "states": ground.part.mdp.n_states,
        "distinct_optima": len(fine),
        "vertices": len(ground.front().vertices) if config.front else 0,
        "worst_regret": max(row["worst_regret"] for row in dials),
    }
    tables = {"optima": optima, "directions": directions, "dials": dials}
    return Findings(tables, summary, {DIAL: file_of(trained.policy(0))})
