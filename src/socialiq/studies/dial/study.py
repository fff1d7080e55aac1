"""The dial in the 7x7 world: one network for every angle, against the exact optimum of each."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.dial import ceiling_regrets, support_ceiling
from socialiq.evaluation.expert_demonstrations import trajectory_datasets
from socialiq.experiments.gridworld_runs import Ground, seen, with_clock
from socialiq.experiments.study import Context, Findings, StageCallback
from socialiq.experiments.tables import groups, nested
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.presets import RUNS
from socialiq.learners.dial.train import Trained, train
from socialiq.mdp.front import AttainableSet
from socialiq.studies.dial.budgets import budget_tables
from socialiq.studies.dial.config import Config
from socialiq.studies.dial.evaluate import TrainedDial
from socialiq.types import Row


def compute_tables(config: Config, context: Context) -> Findings:
    """Train every run, evaluate exactly at each degree, set the dial, and compute_tables."""
    ground = Ground.of("crossing7")
    tables: dict[str, list[Row]] = {"angles": [], "dials": [], "settings": []}
    data = {
        clock: trajectory_datasets(
            with_clock(ground, clock).table, config.seeds, config.episodes_each
        )
        for clock in (True, False)
    }
    ceilings = _ceilings(ground, config, data[True])
    for name in config.runs:
        trained = _train(ground, config, name, data[RUNS[name].clock], context.on_stage)
        for run, seed in enumerate(config.seeds):
            one = TrainedDial(name, seed, trained.policy(run), with_clock(ground, RUNS[name].clock))
            limit = ceilings.get((RUNS[name].support, seed), ground.optimum.attainable)
            for table, rows in one.rows(config, limit):
                tables[table] += rows
    tables |= budget_tables(with_clock(ground, True), config, data[True], context.on_stage)
    tables["ceilings"] = _ceiling_rows(ground, config, ceilings)
    tables["pooled"] = _pooled(tables["dials"])
    tables["front"] = [
        {"r_env": float(env), "r_social": float(social)}
        for env, social in ground.optimum.attainable.front()
    ]
    return Findings(tables, _summary(tables))


def _train(
    ground: Ground,
    config: Config,
    name: str,
    data: Sequence[Demonstrations],
    on_stage: StageCallback,
) -> Trained:
    structure, numbers, clock, _ = RUNS[name]
    world = with_clock(ground, clock).table.world
    structure = dataclasses.replace(
        structure, one_hot=seen(world), updates=config.updates or structure.updates
    )
    runs = [
        dataclasses.replace(numbers, seed=seed, dataset=number)
        for number, seed in enumerate(config.seeds)
    ]
    return train(
        structure,
        runs,
        data if structure.demonstrations else [],
        world if structure.online else None,
        callbacks=Callbacks(on_report=on_stage(f"7x7 dial, {name}")),
    )


def _ceilings(
    ground: Ground, config: Config, data: Sequence[Demonstrations]
) -> dict[tuple[str, int], AttainableSet]:
    """Best values in each data set's support, by kind of support and seed."""
    part = with_clock(ground, True).part
    wanted = {RUNS[name].support for name in config.runs} - {""}
    return {
        (support, seed): support_ceiling(one, part, timed=support == "timed")
        for support in sorted(wanted)
        for seed, one in zip(config.seeds, data, strict=True)
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
    """Mean, least and largest over seeds of every number of a run and readout."""
    rows = []
    for (name, readout), group in groups(dials, "run", "readout").items():
        row: Row = {"run": name, "readout": readout, "seeds": len(group)}
        for quantity in (key for key in group[0] if key not in ("run", "seed", "readout")):
            values = [one[quantity] for one in group if one[quantity] != ""]
            for what, of in (("mean", np.mean), ("low", min), ("high", max)):
                row[f"{quantity}_{what}"] = float(of(values)) if values else ""
        rows.append(row)
    return rows


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Pooled numbers by run and readout."""
    return {"runs": nested(tables["pooled"], "run", "readout")}
