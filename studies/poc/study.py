"""The 5x5 proof of concept (thesis 6.1, Fig 6.1): action sequences of baseline and targets."""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import equal_trajectories
from socialiq.evaluation.exact import Ground, action_table
from socialiq.evaluation.rollout import MODES, demonstrations_by_mode
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.config import IQLearnConfig
from socialiq.learners.kernel import Trained
from socialiq.nn.q_network import network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.plotting.style import COLORS, figure
from socialiq.results_folder import Results
from socialiq.social.returns import TARGET_KINDS
from socialiq.types import Row
from socialiq.worlds.enumerate import Table, expert_policy
from socialiq_lab.gridworld_runs import Monitor, sequence, train_runs
from socialiq_lab.study import Context, Findings, StageCallback
from socialiq_lab.tables import groups

CHUNK = 1000
"""Updates between two evaluations of the greedy sequences."""

THESIS = {
    "baseline": "WWWWGGGG",
    "egoistic": "GGGG",
    "prosocial": "WGGGG",
    "altruistic": "WWWWGGGG",
}
"""Sequences that the thesis prints."""

KEYS = ("target_kind", "next_value", "policy")

_FILL = {"W": "#d9d9d9", "G": "#2166ac"}
_INK = {"W": "#333333", "G": "white"}


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
    """Train baseline and targets, and compare their greedy action sequences with the thesis'."""
    ground = Ground.of("crossing5")
    data = equal_trajectories(
        demonstrations_by_mode(ground.table, dict.fromkeys(MODES, 1), 0), 1, 0
    )
    preset = dataclasses.replace(presets.POC, updates=config.updates)
    rows: list[Row] = []
    for value in ("online", "target") if config.readings else ("online",):
        static = dataclasses.replace(preset, next_value=value)
        rows += _baseline_rows(ground, static, config, data, context.on_stage)
        for kind in TARGET_KINDS if config.readings else ("running",):
            static = dataclasses.replace(static, target_kind=kind)
            rows += _target_rows(ground, static, config, data, context.on_stage)
    tables = {
        "experts": _expert_rows(ground.table),
        "sequences": rows,
        "agreement": _agreement(rows),
        "agreement_by_updates": _by_updates(rows, config.updates),
    }
    return Findings(tables, _summary(tables))


def _baseline_rows(
    ground: Ground,
    static: IQLearnConfig,
    config: Config,
    data: Demonstrations,
    on_stage: StageCallback,
) -> list[Row]:
    """Train without the regularizer; every seed learns from the same data set."""
    runs = [dataclasses.replace(presets.TABLE_C1_NUMBERS, seed=seed) for seed in config.seeds]
    report = on_stage(f"5x5 baseline, V(s') {static.next_value}")
    modes = ["baseline"] * len(runs)
    monitor = _agreement_monitor(ground, modes)
    trained = train_runs(ground, presets.baseline(static), runs, [data], report, CHUNK, monitor)
    label = {"target_kind": "none", "next_value": static.next_value}
    return _sequence_rows(ground, trained, modes, label)


def _target_rows(
    ground: Ground,
    static: IQLearnConfig,
    config: Config,
    data: Demonstrations,
    on_stage: StageCallback,
) -> list[Row]:
    """Train the three targets of one variant."""
    base = dataclasses.replace(presets.TABLE_C1_NUMBERS, strength=config.strength)
    runs = [
        dataclasses.replace(base, angle=angle, seed=seed)
        for angle in MODES.values()
        for seed in config.seeds
    ]
    report = on_stage(f"5x5 targets, {static.target_kind}, V(s') {static.next_value}")
    modes = [mode for mode in MODES for _ in config.seeds]
    monitor = _agreement_monitor(ground, modes)
    trained = train_runs(ground, static, runs, [data], report, CHUNK, monitor)
    label = {"target_kind": static.target_kind, "next_value": static.next_value}
    return _sequence_rows(ground, trained, modes, label)


def _sequence_rows(ground: Ground, trained: Trained, modes: list[str], label: Row) -> list[Row]:
    """Return a row for each run; `equal_at` lists the updates with the thesis' sequence."""
    equal = trained.history.array("equal")
    rows = []
    for run, mode in enumerate(modes):
        learned = sequence(ground.table, action_table(trained.policy(run), ground.table, "greedy"))
        at = [n for n, yes in zip(trained.history.updates, equal[:, run], strict=True) if yes]
        rows.append(
            {
                "policy": mode,
                **label,
                "seed": trained.hyperparameters[run].seed,
                "sequence": learned,
                "thesis": THESIS[mode],
                "equal": int(learned == THESIS[mode]),
                "equal_at": " ".join(map(str, at)),
            }
        )
    return rows


def _agreement_monitor(ground: Ground, modes: list[str]) -> Monitor:
    """Return whether each run's greedy sequence is the thesis', after every chunk."""

    def monitor(state: Any) -> dict[str, np.ndarray]:
        equal = []
        for run, mode in enumerate(modes):
            policy = QPolicy.of(network_of(state.network, run), 1.0, {})
            greedy = action_table(policy, ground.table, "greedy")
            equal.append(sequence(ground.table, greedy) == THESIS[mode])
        return {"equal": np.array(equal, np.float64)}

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
    """Number of seeds with the thesis' sequence, and the commonest one, by variant and policy."""
    table = []
    for values, group in groups(rows, *KEYS).items():
        commonest, count = Counter(row["sequence"] for row in group).most_common(1)[0]
        table.append(
            dict(zip(KEYS, values, strict=True))
            | {"seeds": len(group), "equal": sum(row["equal"] for row in group)}
            | {"commonest": commonest, "commonest_seeds": count, "thesis": group[0]["thesis"]}
        )
    return table


def _by_updates(rows: list[Row], updates: int) -> list[Row]:
    """Number of seeds with the thesis' sequence, by number of updates."""
    times = [min(n, updates) for n in range(CHUNK, updates + CHUNK, CHUNK)]
    table = []
    for values, group in groups(rows, *KEYS).items():
        counts = Counter(n for row in group for n in row["equal_at"].split())
        label = dict(zip(KEYS, values, strict=True))
        table.append(label | {f"at_{n}": counts[str(n)] for n in times})
    return table


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Policies of the figure, and the number of seeds with all four sequences."""

    def of_figure(row: Row) -> bool:
        return row["next_value"] == "online" and row["target_kind"] in ("none", "running")

    by_seed = groups(list(filter(of_figure, tables["sequences"])), "seed")
    return {
        "policies": {row["policy"]: row for row in filter(of_figure, tables["agreement"])},
        "experts": {row["mode"]: row["sequence"] for row in tables["experts"]},
        "seeds": len(by_seed),
        "all_four": sum(all(row["equal"] for row in rows) for rows in by_seed.values()),
    }


def pictures(results: Results) -> dict[str, Figure]:
    """Draw Fig 6.1: the commonest sequence of each policy over seeds, beside the thesis'."""
    picture = figure(8.0, 4.2)
    axes = picture.add_subplot()
    policies = results.summary["policies"]
    for row, (name, entry) in enumerate(policies.items()):
        y = -row * 1.5
        agreeing = f"{entry['commonest_seeds']} of {entry['seeds']} seeds"
        axes.text(-0.3, y, name, ha="right", va="bottom", color=COLORS[name], weight="bold")
        axes.text(-0.3, y - 0.05, agreeing, ha="right", va="top", fontsize=8, color="#555555")
        _draw_sequence(axes, entry["commonest"], y, 0.62)
        axes.text(9.3, y, f"thesis: {entry['thesis']}", va="center", fontsize=9, family="monospace")
    axes.set(xlim=(-2.6, 12.2), ylim=(-1.5 * len(policies) + 0.7, 0.8))
    axes.axis("off")
    axes.set_title("5x5: greedy actions after training on one mixed data set (W wait, G go)")
    return {"fig_6_1": picture}


def _draw_sequence(axes: Any, letters: str, y: float, height: float) -> None:
    """Draw a box for each action; a long sequence is cut off."""
    for x, letter in enumerate(letters if len(letters) <= 9 else letters[:8] + "…"):
        fill = _FILL.get(letter, "white")
        axes.add_patch(Rectangle((x, y - height / 2), 0.9, height, facecolor=fill))
        axes.text(x + 0.45, y, letter, ha="center", va="center", color=_INK.get(letter, "#333333"))
