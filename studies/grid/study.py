"""The 7x7 study (thesis 6.2, Figs 6.2-6.4): baseline and three targets from one mixed data set."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.expert_demonstrations import (
    MODES,
    trajectory_datasets,
    transition_datasets,
)
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import presets
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Row
from socialiq_lab.gridworld_runs import Ground, grid_of, pooled, rows_of, train_runs
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, StageCallback, Study, View
from studies.grid.evaluate import attainable_rows, distances, expert_rows, heatmaps
from studies.grid.figures import THESIS_ANGLES, draw_figures

KEYS = ("method", "mixture", "target_kind", "strength", "target_angle", "readout")


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14, 15, 16, 17, 18, 19)
    """Training seeds, each with its own data set. 0 to 9 were used in development."""
    episodes_each: int = 60
    """Episodes of each expert in the equal-trajectories mixture."""
    transitions_each: int = 600
    """Transitions of each expert in the equal-transitions mixture."""
    target_kinds: tuple[str, ...] = ("running", "to_go", "trajectory", "instantaneous")
    """Target kinds that are compared; the figures show the first."""
    strengths: tuple[float, ...] = (2.0, 1.0)
    """λ of the comparison; the first makes the figures."""
    updates: int = presets.GRID.updates
    """Gradient steps."""
    comparisons: bool = True
    """Whether to train the comparisons too: the equal-transitions mixture, and clones."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train baseline, targets and clones, and evaluate them exactly."""
    ground = Ground.of("crossing7")
    trajectories = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    data = {"equal_trajectories": trajectories}
    rows, headline = _main_rows(ground, config, trajectories, context.on_stage)
    if config.comparisons:
        data["equal_transitions"] = transition_datasets(
            ground.table, config.seeds, config.transitions_each
        )
        rows += _comparison_rows(ground, config, data, context.on_stage)
    experts = expert_rows(ground)
    tables = {
        "experts": experts,
        "policies": rows,
        "pooled": pooled(rows, KEYS),
        "heatmaps": heatmaps(ground, headline),
        "distances": distances(ground, headline),
        "attainable": attainable_rows(ground),
        "data": _data_rows(data),
    }
    return Findings(tables, _summary(tables, config))


def _main_rows(
    ground: Ground, config: Config, datasets: list[Demonstrations], on_stage: StageCallback
) -> tuple[list[Row], dict[str, list[QPolicy]]]:
    """Train baseline and targets of every variant; return rows, and the figures' policies."""
    label = {"mixture": "equal_trajectories"}
    rows, baseline = _train_baseline(ground, config, datasets, label, on_stage)
    headline = {"baseline": baseline}
    for kind in config.target_kinds:
        more, policies = _train_targets(ground, config, datasets, label, kind, on_stage)
        rows += more
        if kind == config.target_kinds[0]:
            headline |= policies
    return rows, headline


def _train_baseline(
    ground: Ground,
    config: Config,
    datasets: list[Demonstrations],
    label: Row,
    on_stage: StageCallback,
) -> tuple[list[Row], list[QPolicy]]:
    """Train IQ-Learn without a social prior; a row for each target angle has the regret there."""
    static = dataclasses.replace(presets.baseline(presets.GRID), updates=config.updates)
    runs = grid_of([0.0], [0.0], config.seeds, presets.TABLE_C1_NUMBERS)
    report = on_stage(f"7x7 baseline, {label['mixture'].replace('_', ' ')}")
    trained = train_runs(ground, static, runs, datasets, report)
    policies = [trained.policy(run) for run in range(len(runs))]
    rows: list[Row] = []
    for angle in MODES.values():
        described = _label("baseline", label, "none", 0.0, angle)
        rows += rows_of(ground, policies, angle, described, config.seeds)
    return rows, policies


def _train_targets(
    ground: Ground,
    config: Config,
    datasets: list[Demonstrations],
    label: Row,
    kind: str,
    on_stage: StageCallback,
) -> tuple[list[Row], dict[str, list[QPolicy]]]:
    """Train the targets at every strength in one program; return the first strength's policies."""
    static = dataclasses.replace(presets.GRID, target_kind=kind, updates=config.updates)
    angles = list(MODES.values())
    runs = grid_of(angles, config.strengths, config.seeds, presets.TABLE_C1_NUMBERS)
    report = on_stage(f"7x7 targets, {kind}, {label['mixture'].replace('_', ' ')}")
    trained = train_runs(ground, static, runs, datasets, report)
    rows: list[Row] = []
    headline: dict[str, list[QPolicy]] = {}
    run = 0
    for mode, angle in MODES.items():
        for strength in config.strengths:
            policies = [trained.policy(run + i) for i in range(len(config.seeds))]
            run += len(config.seeds)
            headline.setdefault(mode, policies)
            described = _label("reward_regularized", label, kind, strength, angle)
            rows += rows_of(ground, policies, angle, described, config.seeds)
    return rows, headline


def _comparison_rows(
    ground: Ground, config: Config, data: dict[str, list[Demonstrations]], on_stage: StageCallback
) -> list[Row]:
    """Train the figures' variant on the other mixture, and clone both mixtures."""
    label = {"mixture": "equal_transitions"}
    rows, _ = _train_baseline(ground, config, data["equal_transitions"], label, on_stage)
    kind = config.target_kinds[0]
    rows += _train_targets(ground, config, data["equal_transitions"], label, kind, on_stage)[0]
    static = bc.StaticConfig(updates=config.updates)
    runs = [bc.Hyperparameters(seed=seed, dataset=i) for i, seed in enumerate(config.seeds)]
    for mixture, datasets in data.items():
        callbacks = Callbacks(on_report=on_stage(f"7x7 clones, {mixture.replace('_', ' ')}"))
        cloned = bc.BehaviourCloning.train_on(static, runs, datasets, callbacks)
        policies = [cloned.policy(run) for run in range(len(runs))]
        for angle in MODES.values():
            described = _label("behaviour_cloning", {"mixture": mixture}, "none", 0.0, angle)
            rows += rows_of(ground, policies, angle, described, config.seeds)
    return rows


def _label(method: str, label: Row, kind: str, strength: float, angle: float) -> Row:
    return {
        "method": method,
        **label,
        "target_kind": kind,
        "strength": strength,
        "target_angle": angle,
    }


def _data_rows(data: dict[str, list[Demonstrations]]) -> list[Row]:
    return [
        {
            "mixture": mixture,
            "dataset": number,
            "mode": mode,
            "episodes": episodes,
            "transitions": transitions,
            "share_of_transitions": transitions / table.n_transitions,
        }
        for mixture, tables in data.items()
        for number, table in enumerate(tables)
        for mode, (episodes, transitions) in table.counts().items()
    ]


def _summary(tables: dict[str, list[Row]], config: Config) -> dict[str, Any]:
    """Pooled metrics of the figures' policies by name and action selection, and the experts'."""
    chosen: dict[str, dict] = {}
    names = {angle: mode for mode, angle in MODES.items()}
    for row in tables["pooled"]:
        if row["mixture"] != "equal_trajectories":
            continue
        if row["method"] == "baseline":
            name = f"baseline_{row['readout']}"
            entry = chosen.setdefault(name, {key: row[key] for key in row if key not in KEYS})
            entry[f"regret_at_{row['target_angle']:g}"] = row["regret"]
        elif (row["method"], row["target_kind"], row["strength"]) == (
            "reward_regularized",
            config.target_kinds[0],
            config.strengths[0],
        ):
            name = f"{names[row['target_angle']]}_{row['readout']}"
            chosen[name] = {key: row[key] for key in row if key not in KEYS}
    experts = {row["mode"]: row for row in tables["experts"]}
    return {"policies": chosen, "experts": experts}


def view(results: Results) -> Sequence[View]:
    """Return the policies of the figures beside the thesis' and the optimum's angles."""
    return [View(comparison(results), "angle in degrees; greedy, means over seeds, exact")]


def comparison(results: Results) -> list[Row]:
    """Return target angle and achieved angle, the thesis' and the optimum's, by policy."""
    rows: list[Row] = []
    for name, angle in {"baseline": None, **MODES}.items():
        entry = results.summary["policies"][f"{name}_greedy"]
        expert = results.summary["experts"].get(name, {})
        rows.append(
            {
                "policy": name,
                "target": "none" if angle is None else f"{angle:g}",
                "angle": entry["angle"],
                "thesis": THESIS_ANGLES[name],
                "optimum": expert.get("angle", ""),
                "regret": "" if angle is None else entry["regret"],
                "arrival": entry["arrival"],
                "timeout": entry["timeout"],
            }
        )
    return rows


STUDY = Study(
    name="grid",
    Config=Config,
    tables=compute_tables,
    figures=draw_figures,
    view=view,
)
