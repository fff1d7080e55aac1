"""The dial in the 7x7 world: one network for every angle, against the exact optimum of each."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Sequence
from pathlib import Path

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.dial import ceiling_regrets, support_ceiling
from socialiq.evaluation.expert_demonstrations import trajectory_datasets
from socialiq.evaluation.ground import Ground, with_clock
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import PRESETS
from socialiq.learners.dial.train import train
from socialiq.learners.kernel import Trained
from socialiq.mdp.front import AttainableSet
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import Row
from socialiq_lab.study import Context, Findings, StageCallback, Study, view_of
from socialiq_lab.tables import groups, nested, spread
from studies.dial.budgets import budget_tables
from studies.dial.config import Config
from studies.dial.evaluate import TrainedDial
from studies.dial.figures import draw_figures

DIAL = "dial.safetensors"
"""File of the first run's first dial in the results folder: chosen before any was evaluated."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train every run, evaluate it exactly at each degree, and set its mixtures."""
    ground = Ground.of("crossing7")
    tables: dict[str, list[Row]] = {"angles": [], "dials": [], "settings": []}
    data = {
        clock: trajectory_datasets(
            with_clock(ground, clock).table, config.seeds, config.episodes_each
        )
        for clock in (True, False)
    }
    ceilings = _ceilings(ground, config, data[True])
    files: dict[str, bytes] = {}
    for name in config.runs:
        trained = _train(ground, config, name, data[PRESETS[name].clock], context.on_stage)
        for run, seed in enumerate(config.seeds):
            dial = TrainedDial(
                name, seed, trained.policy(run), with_clock(ground, PRESETS[name].clock)
            )
            files = files or {DIAL: _file_of(dial.dial)}
            limit = ceilings.get((PRESETS[name].support, seed), ground.optimum.attainable)
            for table, rows in dial.rows(config, limit):
                tables[table] += rows
    if "offline" in config.runs:
        tables |= budget_tables(with_clock(ground, True), config, data[True], context.on_stage)
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
    world = with_clock(ground, clock).table.world
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
    part = with_clock(ground, True).part
    wanted = {PRESETS[name].support for name in config.runs} - {""}
    return {
        (support, seed): support_ceiling(demonstrations, part, timed=support == "timed")
        for support in sorted(wanted)
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
            given = [dial for dial in group if dial[name] != ""]
            of_seeds = spread(given, name) if given else dict.fromkeys(("mean", "low", "high"), "")
            row |= {f"{name}_{what}": value for what, value in of_seeds.items()}
        rows.append(row)
    return rows


STUDY = Study(
    name="dial",
    Config=Config,
    tables=compute_tables,
    figures=draw_figures,
    view=view_of(
        "pooled",
        "run",
        "readout",
        "key_regret_mean",
        "key_regret_high",
        "ceiling_mean",
        "rise_r_env_high",
        "drop_r_social_high",
        "least_share_of_support_low",
        title="over seeds; key regret: mean regret at 0, 15, ..., 90 degrees, exact",
    ),
)
