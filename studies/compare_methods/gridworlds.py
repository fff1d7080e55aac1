"""The comparison in a gridworld: train all runs of a method, evaluate each exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.evaluation.exact import READOUTS, Readout, action_table, evaluate_exactly
from socialiq.evaluation.expert_demonstrations import trajectory_datasets
from socialiq.learners.collect import from_env
from socialiq.learners.iq_learn import config as iq
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.gym import GridWorldEnv
from socialiq_lab.gridworld_runs import Ground
from socialiq_lab.jobs import ProgressCallback
from socialiq_lab.results import as_csv
from studies.compare_methods import peers
from studies.compare_methods.arena import Arena, Run, runs_of, speed_row
from studies.compare_methods.config import trained_angles, updates_of
from studies.compare_methods.methods import BY_NAME, PEERS, Method, Setting
from studies.compare_methods.training import LEARNERS

ROWS, SPEED = "rows.csv", "speed.csv"
"""Files of a job: a row for each policy and angle; updates per second."""


@dataclass(frozen=True)
class GridRuns:
    """Runs of a method in a gridworld, at every angle, setting and seed."""

    world: str
    method: str
    structure: iq.StaticConfig
    numbers: iq.Hyperparameters
    updates: int
    """For each angle."""
    angles: tuple[float, ...]
    settings: tuple[Setting, ...]
    seeds: tuple[int, ...]
    episodes_each: int


def run_method(
    config: GridRuns, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train every run and write a row for each policy, angle and action selection."""
    ground, method = Ground.of(config.world), BY_NAME[config.method]
    arena = Arena(
        config.structure,
        config.numbers,
        updates_of(method, config.updates),
        trajectory_datasets(ground.table, config.seeds, config.episodes_each),
        ground.table.world,
        lambda steps: from_env(GridWorldEnv(config.world), steps),
        lambda report: on_progress(0.9 * report.done / report.total),
    )
    served = trained_angles(method, config.angles)
    runs = runs_of(config.settings, served, config.seeds)
    if method.learner in PEERS:
        (environment,) = inputs.values()
        policies = peers.train_tabular(arena, ground, method, runs, served, environment, folder)
    else:
        policies = LEARNERS[method.learner](arena, method, runs)
    rows: list[Row] = []
    for run, policy in zip(runs, policies, strict=True):
        rows += rows_of(ground, config, run, policy, served[run.angle])
    write_atomically(folder / ROWS, as_csv(rounded(rows)))
    write_atomically(folder / SPEED, as_csv([speed_row(config.world, method, arena, len(runs))]))
    on_progress(1.0)


def rows_of(
    ground: Ground, config: GridRuns, run: Run, policy: Any, angles: Sequence[float]
) -> list[Row]:
    """Return a policy's exact metrics and its regret at each angle that it serves."""
    rows: list[Row] = []
    method = BY_NAME[config.method]
    for angle in angles:
        for readout in READOUTS if method.soft else READOUTS[:1]:
            metrics = evaluate_exactly(ground.part, chances(ground, policy, angle, readout))
            label = {"world": config.world, "method": method.name}
            label |= {"setting": setting_name(run.setting), "target_angle": angle}
            label |= {"readout": readout, "seed": run.seed}
            regret = ground.optimum.regret(metrics, angle)
            values = {"value": metrics.value(angle), "regret": regret}
            rows.append(label | metrics._asdict() | values)
    return rows


def chances(
    ground: Ground, policy: Any, angle: float, readout: Readout
) -> Float[np.ndarray, "state action"]:
    """Return action probabilities of a policy at an angle.

    Args:
        ground: The world.
        policy: A policy, one with `at`, or a table of probabilities by angle of a peer.
        angle: In degrees.
        readout: Action selection.
    """
    if isinstance(policy, Mapping):
        table = policy[angle]
        greedy = np.eye(table.shape[1])[table.argmax(axis=1)]
        return greedy if readout == "greedy" else table
    turned = policy.at(angle) if hasattr(policy, "at") else policy
    return action_table(turned, ground.part, readout)


def setting_name(setting: Setting) -> str:
    """Return a setting in one cell of a table."""
    return ", ".join(f"{name} {value:g}" for name, value in setting)


def setting_of(method: Method, name: str) -> Setting:
    """Return the setting of that name in a method's grid."""
    return next(one for one in method.settings if setting_name(one) == name)
