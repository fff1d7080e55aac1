"""Strength by a budget: offline agents of one angle with a regret of at most ε."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS
from socialiq.evaluation.ground import Ground, exact_regret, regret_at
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import RUNS, DialConfig, DialHyperparameters
from socialiq.learners.dial.train import ASCENT_EVERY, Budget, train
from socialiq.learners.kernel import Trained
from socialiq.types import Row
from socialiq_lab.study import StageCallback
from studies.dial.config import Config


class Agents(NamedTuple):
    """Runs of one static config, each with its own budget."""

    static: DialConfig
    numbers: list[DialHyperparameters]
    budgets: list[float]


def budget_tables(
    ground: Ground, config: Config, data: Sequence[Demonstrations], on_stage: StageCallback
) -> dict[str, list[Row]]:
    """Train an agent for each budget and seed; return the results and the paths of the multipliers.

    Args:
        ground: The world with its clock.
        config: Configuration of the study.
        data: A data set for each of the study's seeds.
        on_stage: Shows progress.
    """
    agents = _agents(ground, config)
    budget = Budget(exact_regret(ground, agents.static, agents.numbers), np.array(agents.budgets))
    trained = train(
        agents.static,
        agents.numbers,
        data,
        callbacks=Callbacks(on_report=on_stage("7x7 dial, budgets")),
        chunk=ASCENT_EVERY,
        budget=budget,
    )
    rows = [_row(ground, config, agents, trained, data, run) for run in range(len(agents.numbers))]
    path: list[Row] = [
        {
            "budget": agents.budgets[run],
            "seed": numbers.seed,
            "updates": step.updates,
            "regret": float(step.regret[run]),
            "multiplier": float(step.multiplier[run]),
        }
        for step in budget.path
        for run, numbers in enumerate(agents.numbers)
    ]
    return {"budgets": rows, "budget_path": path}


def _agents(ground: Ground, config: Config) -> Agents:
    angle, offline = config.budget_angle, RUNS["offline"]
    static = dataclasses.replace(
        offline.structure,
        low=angle,
        high=angle,
        margin=0.0,
        one_hot=ground.table.world.one_hot,
        updates=config.updates or offline.structure.updates,
    )
    runs = [
        (dataclasses.replace(offline.numbers, seed=seed, dataset=config.seeds.index(seed)), epsilon)
        for epsilon in config.budgets
        for seed in config.budget_seeds
    ]
    numbers, budgets = (list(column) for column in zip(*runs, strict=True))
    return Agents(static, numbers, budgets)


def _row(
    ground: Ground,
    config: Config,
    agents: Agents,
    trained: Trained,
    data: Sequence[Demonstrations],
    run: int,
) -> Row:
    """Return the strength of a budget, and the demonstrations' likelihood under its policy."""
    dial, numbers = trained.policy(run), agents.numbers[run]
    demonstrations = data[numbers.dataset]
    chances = dial.at(config.budget_angle).probabilities(demonstrations.observation)
    chosen = chances[np.arange(len(demonstrations.action)), demonstrations.action]
    return {
        "budget": agents.budgets[run],
        "seed": numbers.seed,
        "angle": config.budget_angle,
        "multiplier": float(trained.kept[run]),
        "log_likelihood": float(np.log(np.maximum(chosen, 1e-12)).mean()),
    } | {
        f"regret_{readout}": regret_at(ground, dial, config.budget_angle, readout)
        for readout in READOUTS
    }
