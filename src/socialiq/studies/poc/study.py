"""The 5x5 proof of concept (thesis 6.1, Fig 6.1): action sequences of baseline and targets."""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import equal_trajectories
from socialiq.evaluation.exact import action_table
from socialiq.evaluation.expert_demonstrations import MODES, expert_pools
from socialiq.experiments.gridworld_runs import Ground, Monitor, sequence, train_runs
from socialiq.experiments.study import Context, Findings, StageCallback
from socialiq.experiments.tables import groups
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import StaticConfig
from socialiq.learners.iq_learn.train import Trained
from socialiq.nn.q_network import network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.social.returns import TARGET_KINDS
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.tabular_policy import expert_policy

CHUNK = 1000  # updates between two looks at the sequences
THESIS = {
    "baseline": "WWWWGGGG",
    "egoistic": "GGGG",
    "prosocial": "WGGGG",
    "altruistic": "WWWWGGGG",
}


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (20, 21, 22, 23, 24, 25, 26, 27, 28, 29)
    """Training seeds; 0 to 9 were used in development, 10 to 19 in a first run at 6,000."""
    strength: float = presets.POC_STRENGTH
    """λ."""
    updates: int = presets.POC.updates
    """Gradient steps of the figure."""
    readings: bool = True
    """Whether to train the other target kinds and variants of V(s') too."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train, read the greedy action sequences, and compute_tables."""
    ground = Ground.of("crossing5")
    data = equal_trajectories(expert_pools(ground.table, dict.fromkeys(MODES, 1), 0), 1, 0)
    first = dataclasses.replace(presets.POC, updates=config.updates)
    rows: list[Row] = []
    for value in ("online", "target") if config.readings else ("online",):
        structure = dataclasses.replace(first, next_value=value)
        rows += _baseline_rows(ground, structure, config, data, context.on_stage)
        for kind in TARGET_KINDS if config.readings else ("running",):
            one = dataclasses.replace(structure, target_kind=kind)
            rows += _target_rows(ground, one, config, data, context.on_stage)
    tables = {
        "experts": _expert_rows(ground.table),
        "sequences": rows,
        "agreement": _agreement(rows),
        "agreement_by_updates": _by_updates(rows, config.updates),
    }
    return Findings(tables, _summary(tables))


def _baseline_rows(
    ground: Ground,
    structure: StaticConfig,
    config: Config,
    data: Demonstrations,
    on_stage: StageCallback,
) -> list[Row]:
    """The regularizer off; every seed learns from the one data set there is."""
    numbers = [dataclasses.replace(presets.TABLE_C1_NUMBERS, seed=seed) for seed in config.seeds]
    report = on_stage(f"5x5 baseline, V(s') {structure.next_value}")
    modes = ["baseline"] * len(numbers)
    monitor = _agreement_monitor(ground, modes)
    trained = train_runs(
        ground, presets.baseline(structure), numbers, [data], report, CHUNK, monitor
    )
    label = {"target_kind": "none", "next_value": structure.next_value}
    return _rows(ground, trained, modes, label)


def _target_rows(
    ground: Ground,
    structure: StaticConfig,
    config: Config,
    data: Demonstrations,
    on_stage: StageCallback,
) -> list[Row]:
    """The three targets under one reading."""
    numbers = [
        dataclasses.replace(
            presets.TABLE_C1_NUMBERS, angle=angle, strength=config.strength, seed=seed
        )
        for angle in MODES.values()
        for seed in config.seeds
    ]
    report = on_stage(f"5x5 targets, {structure.target_kind}, V(s') {structure.next_value}")
    modes = [mode for mode in MODES for _ in config.seeds]
    monitor = _agreement_monitor(ground, modes)
    trained = train_runs(ground, structure, numbers, [data], report, CHUNK, monitor)
    label = {"target_kind": structure.target_kind, "next_value": structure.next_value}
    return _rows(ground, trained, modes, label)


def _rows(ground: Ground, trained: Trained, modes: list[str], label: Row) -> list[Row]:
    """One row for each lane; `equal_at` lists the updates at which it showed the sequence."""
    equal = trained.history.array("equal")
    rows = []
    for run, mode in enumerate(modes):
        found = sequence(ground.table, action_table(trained.policy(run), ground.table, "greedy"))
        at = [n for n, yes in zip(trained.history.updates, equal[:, run], strict=True) if yes]
        rows.append(
            {
                "policy": mode,
                **label,
                "seed": trained.hyperparameters[run].seed,
                "sequence": found,
                "thesis": THESIS[mode],
                "equal": int(found == THESIS[mode]),
                "equal_at": " ".join(map(str, at)),
            }
        )
    return rows


def _agreement_monitor(ground: Ground, modes: list[str]) -> Monitor:
    """Whether each lane's greedy sequence is the thesis', after every chunk."""

    def monitor(state: Any) -> dict[str, np.ndarray]:
        found = []
        for run, mode in enumerate(modes):
            policy = QPolicy.of(network_of(state.network, run), 1.0, {})
            greedy = action_table(policy, ground.table, "greedy")
            found.append(sequence(ground.table, greedy) == THESIS[mode])
        return {"equal": np.array(found, np.float64)}

    return monitor


def _expert_rows(table: Table) -> list[Row]:
    return [
        {
            "mode": mode,
            "angle": angle,
            "sequence": sequence(table, expert_policy(table, angle)),
            "thesis": THESIS[mode],
        }
        for mode, angle in MODES.items()
    ]


def _agreement(rows: list[Row]) -> list[Row]:
    """Seeds that show the thesis' sequence, and the commonest sequence, by reading and policy."""
    keys = ("target_kind", "next_value", "policy")
    table = []
    for values, group in groups(rows, *keys).items():
        commonest, count = Counter(row["sequence"] for row in group).most_common(1)[0]
        table.append(
            dict(zip(keys, values, strict=True))
            | {"seeds": len(group), "equal": sum(row["equal"] for row in group)}
            | {"commonest": commonest, "commonest_seeds": count, "thesis": group[0]["thesis"]}
        )
    return table


def _by_updates(rows: list[Row], updates: int) -> list[Row]:
    """Number of seeds that showed the thesis' sequence after so many updates."""
    keys = ("target_kind", "next_value", "policy")
    counts: dict[tuple, Counter] = {}
    for row in rows:
        counter = counts.setdefault(tuple(row[key] for key in keys), Counter())
        counter.update(row["equal_at"].split())
    times = [min(n, updates) for n in range(CHUNK, updates + CHUNK, CHUNK)]
    return [
        dict(zip(keys, values, strict=True)) | {f"at_{n}": counter[str(n)] for n in times}
        for values, counter in counts.items()
    ]


def _summary(tables: dict[str, list[Row]]) -> dict:
    """The figure's reading by policy, and how many seeds show all four sequences together."""

    def of_figure(row: Row) -> bool:
        return row["next_value"] == "online" and row["target_kind"] in ("none", "running")

    together: dict[int, list[int]] = {}
    for row in filter(of_figure, tables["sequences"]):
        together.setdefault(row["seed"], []).append(row["equal"])
    return {
        "policies": {row["policy"]: row for row in filter(of_figure, tables["agreement"])},
        "experts": {row["mode"]: row["sequence"] for row in tables["experts"]},
        "seeds": len(together),
        "all_four": sum(all(equal) for equal in together.values()),
    }
