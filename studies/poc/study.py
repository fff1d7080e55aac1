"""The 5x5 proof of concept (thesis 6.1, Fig 6.1): action sequences of baseline and targets."""

import dataclasses
import itertools
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from socialiq import Demonstrations, QPolicy, equal_trajectories, tabulate
from socialiq.evaluation.exact import Ground, action_table
from socialiq.evaluation.rollout import MODES, demonstrations_by_mode
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.config import IQLearnConfig
from socialiq.nn.q_network import network_of
from socialiq.plotting.style import COLORS, figure
from socialiq.results_folder import Results
from socialiq.social.returns import TARGET_KINDS
from socialiq.types import Row
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import expert_policy
from socialiq_lab.gridworld_runs import sequence, train_runs
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import groups, labelled

CHUNK = 1000  # updates between two evaluations of the greedy sequences

THESIS: dict[str, str] = declaration("poc")["thesis"]
"""Sequences that the thesis prints."""

KEYS = ("target_kind", "next_value", "policy")
_COLORS = {"W": ("#d9d9d9", "#333333"), "G": ("#2166ac", "white")}


def jobs(config: Any) -> list[Job]:
    """Return a job for each variant of V(s') and target kind, "none" for the baseline."""
    values = ("online", "target") if config.readings else ("online",)
    kinds = "none", *(TARGET_KINDS if config.readings else ("running",))
    return [
        Job(f"training/{value}, {kind}", sequences, Part(config, (value, kind)))
        for value, kind in itertools.product(values, kinds)
    ]


@keeps_rows
def sequences(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Train a variant, and return its greedy action sequences."""
    value, kind = part.of
    ground = Ground.of("crossing5")
    episodes = demonstrations_by_mode(ground.table, dict.fromkeys(MODES, 1), 0)
    data = equal_trajectories(episodes, 1, 0)  # one for all seeds
    static = dataclasses.replace(presets.POC, updates=part.study.updates, next_value=value)
    if kind != "none":
        static = dataclasses.replace(static, target_kind=kind)
    return {"sequences": _train(ground, static, kind, part.study, data, on_stage)}


def compute_tables(config: Any, context: Context) -> Findings:
    """Compare the greedy action sequences of baseline and targets with the thesis'.

    Args:
        config: Configuration of the study.
        context: The finished jobs.

    Returns:
        Tables `experts`, `sequences`, `agreement` and `agreement_by_updates`, and the summary.
    """
    table = tabulate(make_grid("crossing5"))
    rows = context.tables()["sequences"]
    experts = {mode: sequence(table, expert_policy(table, angle)) for mode, angle in MODES.items()}
    tables = {
        "experts": [
            {"mode": mode, "angle": MODES[mode], "sequence": letters, "thesis": THESIS[mode]}
            for mode, letters in experts.items()
        ],
        "sequences": rows,
        "agreement": _agreement(rows),
        "agreement_by_updates": _by_updates(rows, config.updates),
    }

    def of_figure(row: Row) -> bool:
        return row["next_value"] == "online" and row["target_kind"] in ("none", "running")

    by_seed = groups(list(filter(of_figure, rows)), "seed")
    summary = {
        "policies": {row["policy"]: row for row in filter(of_figure, tables["agreement"])},
        "experts": experts,
        "seeds": len(by_seed),
        "all_four": sum(all(row["equal"] for row in group) for group in by_seed.values()),
    }
    return Findings(tables, summary)


def _train(
    ground: Ground,
    static: IQLearnConfig,
    kind: str,
    config: Any,
    data: Demonstrations,
    on_stage: StageCallback,
) -> list[Row]:
    """Train the targets of a kind, or the baseline; return a row for each run."""
    numbers = presets.TABLE_C1_NUMBERS
    angles = MODES
    if kind == "none":
        static = presets.baseline(static)
        angles = {"baseline": numbers.angle}
    else:
        numbers = dataclasses.replace(numbers, strength=config.strength)
    cells = list(itertools.product(angles, config.seeds))
    runs = [dataclasses.replace(numbers, angle=angles[mode], seed=seed) for mode, seed in cells]

    def letters(policy: QPolicy) -> str:
        return sequence(ground.table, action_table(policy, ground.table, "greedy"))

    def monitor(state: Any) -> dict[str, np.ndarray]:
        """Return whether each run's greedy sequence is the thesis', after every chunk."""
        equal = [
            letters(QPolicy.of(network_of(state.network, run), 1.0, {})) == THESIS[mode]
            for run, (mode, _) in enumerate(cells)
        ]
        return {"equal": np.array(equal, np.float64)}

    callbacks = Callbacks(on_stage(kind))
    trained = train_runs(ground, static, runs, [data], callbacks, CHUNK, monitor)
    equal = trained.history.array("equal")
    rows = []
    for run, (mode, seed) in enumerate(cells):
        learned = letters(trained.policy(run))
        at = [n for n, yes in zip(trained.history.updates, equal[:, run], strict=True) if yes]
        row = {
            "policy": mode,
            "target_kind": kind,
            "next_value": static.next_value,
            "seed": seed,
            "sequence": learned,
            "thesis": THESIS[mode],
            "equal": int(learned == THESIS[mode]),
        }
        rows.append(row | {"equal_at": " ".join(map(str, at))})
    return rows


def _agreement(rows: list[Row]) -> list[Row]:
    """Number of seeds with the thesis' sequence, and the commonest one, by variant and policy."""
    table = []
    for label, group in labelled(rows, *KEYS):
        commonest, count = Counter(row["sequence"] for row in group).most_common(1)[0]
        table.append(
            label
            | {"seeds": len(group), "equal": sum(row["equal"] for row in group)}
            | {"commonest": commonest, "commonest_seeds": count, "thesis": group[0]["thesis"]}
        )
    return table


def _by_updates(rows: list[Row], updates: int) -> list[Row]:
    """Number of seeds with the thesis' sequence, by number of updates."""
    times = [min(n, updates) for n in range(CHUNK, updates + CHUNK, CHUNK)]
    table = []
    for label, group in labelled(rows, *KEYS):
        counts = Counter(n for row in group for n in row["equal_at"].split())
        table.append(label | {f"at_{n}": counts[str(n)] for n in times})
    return table


def pictures(results: Results) -> dict[str, Figure]:
    """Draw Fig 6.1: the commonest sequence of each policy over seeds, and the thesis' sequence."""
    picture = figure(8.0, 4.2)
    axes = picture.add_subplot()
    policies = results.summary["policies"]
    for row, (name, entry) in enumerate(policies.items()):
        y = -row * 1.5
        agreeing = f"{entry['commonest_seeds']} of {entry['seeds']} seeds"
        axes.text(-0.3, y, name, ha="right", va="bottom", color=COLORS[name], weight="bold")
        axes.text(-0.3, y - 0.05, agreeing, ha="right", va="top", fontsize=8, color="#555555")
        letters = entry["commonest"]
        for x, letter in enumerate(letters if len(letters) <= 9 else letters[:8] + "…"):
            fill, ink = _COLORS.get(letter, ("white", "#333333"))
            axes.add_patch(Rectangle((x, y - 0.31), 0.9, 0.62, facecolor=fill))
            axes.text(x + 0.45, y, letter, ha="center", va="center", color=ink)
        axes.text(9.3, y, f"thesis: {entry['thesis']}", va="center", fontsize=9, family="monospace")
    axes.set(xlim=(-2.6, 12.2), ylim=(-1.5 * len(policies) + 0.7, 0.8))
    axes.axis("off")
    equal = sum(entry["commonest"] == entry["thesis"] for entry in policies.values())
    title = f"5x5: {equal} of {len(policies)} policies most often act greedily as the thesis prints"
    axes.set_title(f"{title} (W wait, G go)", fontsize=10)
    return {"fig_6_1": picture}
