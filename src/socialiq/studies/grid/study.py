"""The 7x7 study (thesis 6.2, Figs 6.2-6.4): baseline and three targets from one mixed data set."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import Readout, action_table, evaluate_exactly
from socialiq.evaluation.expert_demonstrations import (
    MODES,
    trajectory_datasets,
    transition_datasets,
)
from socialiq.experiments.gridworld_runs import Ground, grid_of, pooled, rows_of, train_runs
from socialiq.experiments.study import Context, Findings, StageCallback
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import presets
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Row
from socialiq.worlds.tabular_policy import expert_policy

KEYS = ("method", "mixture", "target_kind", "strength", "target_angle", "readout")


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14, 15, 16, 17, 18, 19)
    """Training seeds, each with a data set of its own. 0 to 9 were used in development."""
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
    """Whether to train what goes beyond the figures: the equal-transitions mixture, and clones."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train, evaluate exactly, and compute_tables."""
    ground = Ground.of("crossing7")
    trajectories = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    data = {"equal_trajectories": trajectories}
    rows, headline = _main_rows(ground, config, trajectories, context.on_stage)
    if config.comparisons:
        data["equal_transitions"] = transition_datasets(
            ground.table, config.seeds, config.transitions_each
        )
        rows += _comparison_rows(ground, config, data, context.on_stage)
    experts = _expert_rows(ground)
    tables = {
        "experts": experts,
        "policies": rows,
        "pooled": pooled(rows, KEYS),
        "heatmaps": _heatmaps(ground, headline),
        "distances": _distances(ground, headline),
        "attainable": _attainable(ground),
        "data": _data_rows(data),
    }
    return Findings(tables, _summary(tables, config))


def _main_rows(
    ground: Ground, config: Config, datasets: list[Demonstrations], on_stage: StageCallback
) -> tuple[list[Row], dict[str, list[QPolicy]]]:
    """Baseline and targets for every reading and strength; and the policies of the figures."""
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
    """IQ-Learn without a social prior; its regret is stated at each target angle's own row."""
    structure = dataclasses.replace(presets.baseline(presets.GRID), updates=config.updates)
    numbers = grid_of([0.0], [0.0], config.seeds, presets.TABLE_C1_NUMBERS)
    report = on_stage(f"7x7 baseline, {label['mixture'].replace('_', ' ')}")
    trained = train_runs(ground, structure, numbers, datasets, report)
    policies = [trained.policy(run) for run in range(len(numbers))]
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
    """The three targets at every strength, in one program; policies of the first strength."""
    structure = dataclasses.replace(presets.GRID, target_kind=kind, updates=config.updates)
    angles = list(MODES.values())
    numbers = grid_of(angles, config.strengths, config.seeds, presets.TABLE_C1_NUMBERS)
    report = on_stage(f"7x7 targets, {kind}, {label['mixture'].replace('_', ' ')}")
    trained = train_runs(ground, structure, numbers, datasets, report)
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
    """The other mixture with the figures' reading, and behaviour cloning of both mixtures."""
    label = {"mixture": "equal_transitions"}
    rows, _ = _train_baseline(ground, config, data["equal_transitions"], label, on_stage)
    kind = config.target_kinds[0]
    rows += _train_targets(ground, config, data["equal_transitions"], label, kind, on_stage)[0]
    structure = bc.StaticConfig(updates=config.updates)
    numbers = [bc.Hyperparameters(seed=seed, dataset=i) for i, seed in enumerate(config.seeds)]
    for mixture, datasets in data.items():
        callbacks = Callbacks(on_report=on_stage(f"7x7 clones, {mixture.replace('_', ' ')}"))
        cloned = bc.clone(structure, numbers, datasets, callbacks)
        policies = [cloned.policy(run) for run in range(len(numbers))]
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


def _expert_rows(ground: Ground) -> list[Row]:
    """The experts (stationary, γ 0.99) and, beside each, the optimum that knows the time."""
    kept = ground.table.mdp.reachable()
    rows = []
    for mode, angle in MODES.items():
        metrics = evaluate_exactly(ground.part, expert_policy(ground.table, angle)[kept])
        best = ground.optimum.attainable.optimum(angle)
        rows.append(
            {"mode": mode, "target_angle": angle}
            | metrics._asdict()
            | {"regret": ground.optimum.regret(metrics, angle), "optimum_value": best.value}
        )
    return rows


def _policies_with_experts(
    ground: Ground, headline: dict[str, list[QPolicy]], readout: Readout
) -> dict[str, np.ndarray]:
    """Action tables by name: each expert, and each trained policy averaged over its seeds."""
    kept = ground.table.mdp.reachable()
    tables = {
        f"expert {mode}": expert_policy(ground.table, angle)[kept] for mode, angle in MODES.items()
    }
    for name, policies in headline.items():
        each = [action_table(policy, ground.part, readout) for policy in policies]
        tables[name] = np.mean(each, axis=0)
    return tables


def _heatmaps(ground: Ground, headline: dict[str, list[QPolicy]]) -> list[Row]:
    """P(STOP) in the cell before the conflict by the two vehicles' positions (Figs 6.3, 6.4).

    `weighted` averages over states by the policy's own visits and is empty where it never comes;
    `unweighted` averages over all reachable states alike, which shows states that don't occur.
    """
    states = ground.part.states
    decision = states[:, 0] == 2
    rows = []
    for name, table in _policies_with_experts(ground, headline, "greedy").items():
        visits = _visits(ground, table)
        for y_1 in range(-1, 7):
            for y_2 in range(-1, 7):
                here = decision & (states[:, 2] == y_1) & (states[:, 4] == y_2)
                if not here.any():
                    continue
                weight = float(visits[here].sum())
                stop = table[here, 0]
                rows.append(
                    {
                        "policy": name,
                        "y_1": y_1,
                        "y_2": y_2,
                        "visits": weight,
                        "weighted": float(visits[here] @ stop) / weight if weight > 1e-9 else "",
                        "unweighted": float(stop.mean()),
                    }
                )
    return rows


def _distances(ground: Ground, headline: dict[str, list[QPolicy]]) -> list[Row]:
    """P(STOP) before the conflict by the distance of the nearest approaching vehicle in cells."""
    states = ground.part.states
    decision = states[:, 0] == 2
    gaps = np.where((states[:, [2, 4]] >= 0) & (states[:, [2, 4]] < 3), 3 - states[:, [2, 4]], 9)
    nearest = gaps.min(axis=1)
    rows = []
    for name, table in _policies_with_experts(ground, headline, "greedy").items():
        visits = _visits(ground, table)
        for distance in (1, 2, 3, 9):
            here = decision & (nearest == distance)
            weight = float(visits[here].sum())
            rows.append(
                {
                    "policy": name,
                    "distance": distance if distance < 9 else "none approaching",
                    "visits": weight,
                    "stops": float(visits[here] @ table[here, 0]) / weight if weight > 1e-9 else "",
                }
            )
    return rows


def _visits(ground: Ground, table: np.ndarray) -> np.ndarray:
    evaluation = horizon_evaluation(ground.part.mdp, table, ground.part.world.horizon)
    return evaluation.visits.sum(axis=1)


def _attainable(ground: Ground) -> list[Row]:
    """Attainable rewards by angle: optimum, its angle, and the radius of mixtures."""
    attainable = ground.optimum.attainable
    rows = []
    for angle in range(0, 91, 5):
        best = attainable.optimum(float(angle))
        rows.append(
            {
                "angle": angle,
                "optimum_r_env": best.point.env,
                "optimum_r_social": best.point.social,
                "optimum_value": best.value,
                "radius": attainable.radius(float(angle)),
            }
        )
    return rows


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


def _summary(tables: dict[str, list[Row]], config: Config) -> dict:
    """Pooled metrics of the figures' policies by name and readout, and the experts'."""
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
