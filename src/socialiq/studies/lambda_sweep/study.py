"""The sweep of the regularization strength (thesis appendix D, Figs D.1 and D.2)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS, exact_monitor
from socialiq.evaluation.expert_demonstrations import trajectory_datasets
from socialiq.evaluation.metrics import Metrics
from socialiq.experiments.gridworld_runs import Ground, grid_of, pooled, train_runs
from socialiq.experiments.study import Context, Findings, StageCallback
from socialiq.experiments.tables import groups
from socialiq.learners.iq_learn import presets
from socialiq.learners.iq_learn.config import Hyperparameters
from socialiq.learners.iq_learn.train import Trained
from socialiq.social.angle import angle_difference, angle_of
from socialiq.types import Row

KEYS = ("target_kind", "strength", "readout")
TARGET_ANGLE = 0.0
WITHIN = 20.0  # degrees; the criterion of Fig D.1, read as a distance from the optimum's angle


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds, each with a data set of its own."""
    strengths: tuple[float, ...] = presets.SWEEP_STRENGTHS
    """λ."""
    target_kinds: tuple[str, ...] = ("instantaneous", "running", "to_go")
    """Target kinds; the figures show the first."""
    episodes_each: int = 60
    """Episodes of each expert."""
    updates: int = presets.SWEEP.updates
    """Gradient steps."""
    checkpoint_every: int = 500
    """Updates between two exact evaluations."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Train every strength and seed in one program for each reading, watching the angle."""
    ground = Ground.of("crossing7")
    datasets = trajectory_datasets(ground.table, config.seeds, config.episodes_each)
    goal = ground.optimum.attainable.optimum(TARGET_ANGLE).point
    goal_angle = angle_of(goal.env, goal.social)
    rows = _baseline_rows(ground, config, datasets, context.on_stage)
    for kind in config.target_kinds:
        rows += _sweep_rows(ground, config, datasets, kind, context.on_stage)
    final = [row for row in rows if row["updates"] == config.updates]
    regretted = [
        row | {"regret": ground.optimum.regret(Metrics(*(row[n] for n in Metrics._fields)), 0.0)}
        for row in final
    ]
    tables = {
        "checkpoints": rows,
        "final": regretted,
        "pooled": pooled(regretted, KEYS),
        "adaptation": _adaptation(rows, goal_angle),
    }
    return Findings(tables, _summary(tables, config, goal_angle))


def _baseline_rows(
    ground: Ground, config: Config, datasets: list[Demonstrations], on_stage: StageCallback
) -> list[Row]:
    """The regularizer off; "baseline" in the column of strengths' readings."""
    structure = dataclasses.replace(presets.baseline(presets.SWEEP), updates=config.updates)
    numbers = grid_of([TARGET_ANGLE], [0.0], config.seeds, presets.TABLE_C1_NUMBERS)
    report = on_stage("λ sweep, baseline")
    monitor = exact_monitor(ground.part, [one.temperature for one in numbers])
    trained = train_runs(
        ground, structure, numbers, datasets, report, config.checkpoint_every, monitor
    )
    return _checkpoint_rows(trained, numbers, "baseline")


def _sweep_rows(
    ground: Ground,
    config: Config,
    datasets: list[Demonstrations],
    kind: str,
    on_stage: StageCallback,
) -> list[Row]:
    structure = dataclasses.replace(presets.SWEEP, target_kind=kind, updates=config.updates)
    numbers = grid_of([TARGET_ANGLE], config.strengths, config.seeds, presets.TABLE_C1_NUMBERS)
    report = on_stage(f"λ sweep, {kind}")
    monitor = exact_monitor(ground.part, [one.temperature for one in numbers])
    trained = train_runs(
        ground, structure, numbers, datasets, report, config.checkpoint_every, monitor
    )
    return _checkpoint_rows(trained, numbers, kind)


def _checkpoint_rows(trained: Trained, numbers: list[Hyperparameters], kind: str) -> list[Row]:
    """One row for each checkpoint, lane and readout."""
    history = trained.history
    arrays = {
        (readout, name): history.array(f"{readout}_{name}")
        for readout in READOUTS
        for name in Metrics._fields
    }
    return [
        {
            "target_kind": kind,
            "strength": one.strength,
            "readout": readout,
            "seed": one.seed,
            "updates": updates,
        }
        | {name: float(arrays[readout, name][chunk, run]) for name in Metrics._fields}
        for run, one in enumerate(numbers)
        for readout in READOUTS
        for chunk, updates in enumerate(history.updates)
    ]


def _adaptation(rows: list[Row], goal_angle: float) -> list[Row]:
    """For each lane: when it first came within 20 degrees of the optimum's angle, and settled.

    The thesis writes |α̂ - α_target| < 20 with α_target = 0 and calls -42 degrees reached, so the
    optimum's own angle must be meant. A lane may pass by early and leave again, so the checkpoint
    from which it stays is stated too; both are empty where it never comes, or doesn't stay.
    """
    table = []
    runs = groups(rows, "target_kind", "strength", "readout", "seed")
    for (kind, strength, readout, seed), steps in runs.items():
        near = [abs(angle_difference(row["angle"], goal_angle)) < WITHIN for row in steps]
        first = steps[int(np.argmax(near))]["updates"] if any(near) else ""
        table.append(
            {
                "target_kind": kind,
                "strength": strength,
                "readout": readout,
                "seed": seed,
                "first_update_within": first,
                "settled_update": _settled([row["updates"] for row in steps], near),
                "within_at_end": int(near[-1]),
            }
        )
    return table


def _settled(updates: list[int], near: list[bool]) -> int | str:
    """The checkpoint from which all are near, empty if the last isn't."""
    away = [place for place, close in enumerate(near) if not close]
    after = away[-1] + 1 if away else 0
    return updates[after] if after < len(updates) else ""


def _summary(tables: dict[str, list[Row]], config: Config, goal_angle: float) -> dict:
    """By reading, readout and λ: pooled metrics and the number of seeds that adapted."""
    found: dict[str, dict] = {}
    for row in tables["pooled"]:
        runs = [one for one in tables["adaptation"] if all(one[key] == row[key] for key in KEYS)]
        first = [one["first_update_within"] for one in runs if one["first_update_within"] != ""]
        settled = [one["settled_update"] for one in runs if one["settled_update"] != ""]
        entry = {key: value for key, value in row.items() if key not in KEYS}
        entry |= {
            "adapted_at_end": sum(one["within_at_end"] for one in runs),
            "adapted_ever": len(first),
            "mean_first_update": float(np.mean(first)) if first else None,
            "mean_settled_update": float(np.mean(settled)) if settled else None,
        }
        reading = found.setdefault(row["target_kind"], {}).setdefault(row["readout"], {})
        reading[f"{row['strength']:g}"] = entry
    return {"optimum_angle": goal_angle, "seeds": len(config.seeds), "readings": found}
