"""The dial in the 7x7 world: one network for every angle, against the exact optimum of each.

Agents of one angle whose strength follows from a budget of regret stand beside it.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.dial import ceiling_regrets, support_ceiling
from socialiq.evaluation.exact import READOUTS, Ground, exact_regret
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import PRESETS, RUNS, DialConfig, DialHyperparameters
from socialiq.learners.dial.train import ASCENT_EVERY, Budget, train
from socialiq.learners.kernel import Trained
from socialiq.mdp.front import AttainableSet
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import Row
from socialiq_lab.study import Context, Findings, StageCallback
from socialiq_lab.tables import groups, nested, spread
from studies.dial.evaluate import Config, TrainedDial


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
    angle, numbers = config.budget_angle, agents.numbers[run]
    policy, demonstrations = trained.policy(run).at(angle), data[numbers.dataset]
    chances = policy.probabilities(demonstrations.observation)
    chosen = chances[np.arange(len(demonstrations.action)), demonstrations.action]
    return {
        "budget": agents.budgets[run],
        "seed": numbers.seed,
        "angle": angle,
        "multiplier": float(trained.kept[run]),
        "log_likelihood": float(np.log(np.maximum(chosen, 1e-12)).mean()),
    } | {f"regret_{readout}": ground.regret(policy, angle, readout) for readout in READOUTS}


DIAL = "dial.safetensors"
"""File of the first run's first dial in the results folder: chosen before any was evaluated."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train every run, evaluate it exactly at each degree, and set its mixtures."""
    ground = Ground.of("crossing7")
    tables: dict[str, list[Row]] = {"angles": [], "dials": [], "settings": []}
    data = {
        clock: trajectory_datasets(
            ground.with_clock(clock).table, config.seeds, config.episodes_each
        )
        for clock in (True, False)
    }
    ceilings = _ceilings(ground, config, data[True])
    files: dict[str, bytes] = {}
    for name in config.runs:
        trained = _train(ground, config, name, data[PRESETS[name].clock], context.on_stage)
        for run, seed in enumerate(config.seeds):
            dial = TrainedDial(
                name, seed, trained.policy(run), ground.with_clock(PRESETS[name].clock)
            )
            files = files or {DIAL: _file_of(dial.dial)}
            limit = ceilings.get((PRESETS[name].support, seed), ground.optimum.attainable)
            for table, rows in dial.rows(config, limit):
                tables[table] += rows
    if "offline" in config.runs:
        tables |= budget_tables(ground.with_clock(True), config, data[True], context.on_stage)
    if ceilings:
        tables["ceilings"] = _ceiling_rows(ground, config, ceilings)
    tables["pooled"] = _pooled(tables["dials"])
    tables["front"] = [
        {"r_env": float(env), "r_social": float(social)}
        for env, social in ground.optimum.attainable.front()
    ]
    return Findings(tables, {"runs": nested(tables["pooled"], "run", "readout")}, files)


def _file_of(dial: DialPolicy) -> bytes:
    """Return the content of a dial's file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / DIAL
        dial.save(path)
        return path.read_bytes()


def _train(
    ground: Ground,
    config: Config,
    name: str,
    data: Sequence[Demonstrations],
    on_stage: StageCallback,
) -> Trained:
    static, numbers, clock, _ = PRESETS[name]
    world = ground.with_clock(clock).table.world
    static = dataclasses.replace(
        static, one_hot=world.one_hot, updates=config.updates or static.updates
    )
    runs = [
        dataclasses.replace(numbers, seed=seed, dataset=number)
        for number, seed in enumerate(config.seeds)
    ]
    return train(
        static,
        runs,
        data if static.demonstrations else [],
        world if static.online else None,
        callbacks=Callbacks(on_report=on_stage(f"7x7 dial, {name}")),
    )


def _ceilings(
    ground: Ground, config: Config, data: Sequence[Demonstrations]
) -> dict[tuple[str, int], AttainableSet]:
    """Return the best values within each data set's support, by kind of support and seed."""
    reachable = ground.with_clock(True).part
    supports = {PRESETS[name].support for name in config.runs} - {""}
    return {
        (support, seed): support_ceiling(demonstrations, reachable, timed=support == "timed")
        for support in sorted(supports)
        for seed, demonstrations in zip(config.seeds, data, strict=True)
    }


def _ceiling_rows(
    ground: Ground, config: Config, ceilings: dict[tuple[str, int], AttainableSet]
) -> list[Row]:
    return [
        {"support": support, "seed": seed, "angle": angle, "regret": float(regret)}
        for (support, seed), ceiling in ceilings.items()
        for angle, regret in zip(
            config.wanted, ceiling_regrets(ceiling, ground.optimum, config.wanted), strict=True
        )
    ]


def _pooled(dials: list[Row]) -> list[Row]:
    """Mean, least and largest over seeds of every number of a run and action selection."""
    keys = ("run", "readout")
    rows = []
    for values, group in groups(dials, *keys).items():
        row: Row = dict(zip(keys, values, strict=True)) | {"seeds": len(group)}
        for name in (name for name in group[0] if name not in (*keys, "seed")):
            valued = [dial for dial in group if dial[name] != ""]
            of_seeds = (
                spread(valued, name) if valued else dict.fromkeys(("mean", "low", "high"), "")
            )
            row |= {f"{name}_{what}": value for what, value in of_seeds.items()}
        rows.append(row)
    return rows
