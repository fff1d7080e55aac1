"""Strength by a budget: agents of one angle, offline, whose regret is to be at most ε."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS, Readout, action_table, evaluate_exactly
from socialiq.experiments.gridworld_runs import Ground, seen
from socialiq.experiments.study import StageCallback
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.budget import Budget, Regret
from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.learners.dial.presets import RUNS
from socialiq.learners.dial.train import Trained, dial_of, train
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.studies.dial.config import Config
from socialiq.types import Row

CHUNK = 250  # updates between two steps of dual ascent


class Agents(NamedTuple):
    """Lanes of one structure, each with a budget of its own."""

    structure: StaticConfig
    numbers: list[Hyperparameters]
    budgets: list[float]


def budget_tables(
    ground: Ground, config: Config, data: Sequence[Demonstrations], on_stage: StageCallback
) -> dict[str, list[Row]]:
    """Train an agent for each budget and seed; what it came to, and the way there.

    Args:
        ground: The world with its clock.
        config: Of the study.
        data: A data set for each of the study's seeds.
        on_stage: Shows progress.
    """
    agents = _agents(ground, config)
    budget = Budget(
        exact_regret(ground, agents.structure, agents.numbers), np.array(agents.budgets)
    )
    trained = train(
        agents.structure,
        agents.numbers,
        data,
        callbacks=Callbacks(on_report=on_stage("7x7 dial, budgets")),
        chunk=CHUNK,
        budget=budget,
    )
    rows = [_row(ground, config, agents, trained, data, run) for run in range(len(agents.numbers))]
    path: list[Row] = [
        {
            "budget": agents.budgets[run],
            "seed": numbers.seed,
            "updates": look.updates,
            "regret": float(look.regret[run]),
            "multiplier": float(look.multiplier[run]),
        }
        for look in budget.path
        for run, numbers in enumerate(agents.numbers)
    ]
    return {"budgets": rows, "budget_path": path}


def _agents(ground: Ground, config: Config) -> Agents:
    angle, offline = config.budget_angle, RUNS["offline"]
    structure = dataclasses.replace(
        offline.structure,
        low=angle,
        high=angle,
        margin=0.0,
        one_hot=seen(ground.table.world),
        updates=config.updates or offline.structure.updates,
    )
    runs = [
        (dataclasses.replace(offline.numbers, seed=seed, dataset=config.seeds.index(seed)), epsilon)
        for epsilon in config.budgets
        for seed in config.budget_seeds
    ]
    numbers, budgets = (list(column) for column in zip(*runs, strict=True))
    return Agents(structure, numbers, budgets)


def exact_regret(
    ground: Ground,
    structure: StaticConfig,
    numbers: Sequence[Hyperparameters],
    readout: Readout = "soft",
) -> Regret:
    """The regret of a lane's policy at the one angle of its structure.

    Softly by default: the soft policy's regret falls smoothly with the multiplier, a greedy one's
    in jumps, between which there may be no multiplier for a budget.
    """

    def regret(network: DialNetwork, run: int, multiplier: float) -> float:
        dial = dial_of(structure, numbers[run], network, multiplier)
        return _regret(ground, dial, structure.low, readout)

    return regret


def _regret(ground: Ground, dial: DialPolicy, angle: float, readout: Readout) -> float:
    chances = action_table(dial.at(angle), ground.part, readout)
    return ground.optimum.regret(evaluate_exactly(ground.part, chances), angle)


def _row(
    ground: Ground,
    config: Config,
    agents: Agents,
    trained: Trained,
    data: Sequence[Demonstrations],
    run: int,
) -> Row:
    """Strength of a budget, and the likelihood of the demonstrations under its policy."""
    dial, numbers = trained.policy(run), agents.numbers[run]
    shown = data[numbers.dataset]
    chances = dial.at(config.budget_angle).probabilities(shown.observation)
    chosen = chances[np.arange(len(shown.action)), shown.action]
    return {
        "budget": agents.budgets[run],
        "seed": numbers.seed,
        "angle": config.budget_angle,
        "multiplier": float(trained.kept[run]),
        "log_likelihood": float(np.log(np.maximum(chosen, 1e-12)).mean()),
    } | {
        f"regret_{readout}": _regret(ground, dial, config.budget_angle, readout)
        for readout in READOUTS
    }
