"""Audited policies of the study: of this project, rightly and falsely declared."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from socialiq.audit.profile.profile import Floor
from socialiq.audit.resolve_policy import ATLAS
from socialiq.evaluation.expert_demonstrations import MODES, trajectory_datasets
from socialiq.experiments.gridworld_runs import Ground, grid_of, seen, train_runs, with_clock
from socialiq.experiments.study import StageCallback
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.presets import RUNS
from socialiq.learners.dial.train import train
from socialiq.learners.iq_learn import presets
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.native import save_table
from socialiq.studies.audits.floors import WITHDRAWN, floor_at
from socialiq.worlds.registry import make
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

GRIDWORLD = "crossing7"
_EPISODES_EACH = 60  # demonstrated, of each expert, as in the study `grid`


class AuditedPolicy(NamedTuple):
    """A policy and what is declared of it.

    Attributes:
        world: Where.
        name: For people.
        spec: A specification as `resolve_policy` takes it.
        declared: Angle in degrees.
        made_for: Angle of its training; None for a policy without target angle.
        floor: Of competence.
    """

    world: str
    name: str
    spec: str
    declared: float
    made_for: float | None
    floor: Floor

    @property
    def truthful(self) -> bool:
        """Whether it is declared as what it was made for."""
        return self.made_for == self.declared


def at_intersection(folder: Path) -> Iterator[AuditedPolicy]:
    """The atlas' policies at their own angles, some at others, and one that never moves.

    Args:
        folder: Takes the file of the last.
    """
    families = {"set expert": "set_", "expert": "expert_", "learner": ""}
    for family, prefix in families.items():
        for mode, angle in MODES.items():
            yield _of_atlas(f"{family}, {mode}", f"{prefix}{mode}", angle, angle)
    yield _of_atlas("learner without a prior", "baseline", 45.0, None)
    yield _of_atlas("set expert, egoistic", "set_egoistic", 45.0, 0.0)
    yield _of_atlas("expert, egoistic", "expert_egoistic", 45.0, 0.0)
    yield _of_atlas("set expert, prosocial", "set_prosocial", 90.0, 45.0)
    stands = folder / "stands.safetensors"
    _constant("intersection", 0).save(stands)
    yield AuditedPolicy("intersection", "never moves", str(stands), 90.0, None, WITHDRAWN)


def exact_in_gridworld(folder: Path) -> None:
    """The exact experts of thesis 5.2 as files in a folder."""
    ground = Ground.of(GRIDWORLD)
    for mode, angle in MODES.items():
        policy = TabularPolicy(ground.table.world, expert_policy(ground.table, angle))
        save_table(folder / f"exact_{mode}.safetensors", policy)


def trained_in_gridworld(
    folder: Path, seed: int, updates: tuple[int, int], on_stage: StageCallback
) -> None:
    """A trio with its baseline, and a dial: files in a folder.

    Args:
        folder: To write them to.
        seed: Of the training and of its demonstrations.
        updates: Gradient steps of the trio and of the dial.
        on_stage: Shows progress.
    """
    ground = Ground.of(GRIDWORLD)
    data = trajectory_datasets(ground.table, [seed], _EPISODES_EACH)
    plain = dataclasses.replace(presets.baseline(presets.GRID), updates=updates[0])
    steered = dataclasses.replace(presets.GRID, updates=updates[0])
    numbers = presets.TABLE_C1_NUMBERS
    runs = grid_of(list(MODES.values()), [presets.GRID_STRENGTH], [seed], numbers)
    trio = train_runs(ground, steered, runs, data, on_stage("7x7 trio"))
    for run, mode in enumerate(MODES):
        trio.policy(run).save(folder / f"learner_{mode}.safetensors")
    alone = grid_of([0.0], [0.0], [seed], numbers)
    baseline = train_runs(ground, plain, alone, data, on_stage("7x7 baseline"))
    baseline.policy(0).save(folder / "baseline.safetensors")
    dial = _dial(ground, seed, updates[1], on_stage)
    dial.save(folder / "dial.safetensors")
    dial.at(0.0).save(folder / "dial_stuck.safetensors")


def of_gridworld(folder: Path, dial_angles: tuple[float, ...]) -> Iterator[AuditedPolicy]:
    """Exact and trained policies of a folder, rightly and falsely declared."""
    for family in ("exact", "learner"):
        for mode, angle in MODES.items():
            yield _of_grid(folder, f"{family}_{mode}", angle, angle)
    yield _of_grid(folder, "baseline", 45.0, None)
    for angle in dial_angles:
        yield _of_grid(folder, "dial", angle, angle)
    yield _of_grid(folder, "exact_egoistic", 45.0, 0.0)
    yield _of_grid(folder, "exact_altruistic", 45.0, 90.0)
    yield _of_grid(folder, "learner_egoistic", 45.0, 0.0)
    yield _of_grid(folder, "dial_stuck", 60.0, 0.0)


_GRID_NAMES = {
    "exact": "exact expert",
    "learner": "learner",
    "baseline": "learner without a prior",
    "dial": "dial",
    "dial_stuck": "dial stuck at 0°",
}


def _of_atlas(name: str, file: str, declared: float, made_for: float | None) -> AuditedPolicy:
    return AuditedPolicy(
        "intersection", name, f"{ATLAS}{file}", declared, made_for, floor_at(declared)
    )


def _of_grid(folder: Path, file: str, declared: float, made_for: float | None) -> AuditedPolicy:
    family, _, mode = file.partition("_")
    name = _GRID_NAMES.get(file) or f"{_GRID_NAMES[family]}, {mode}"
    spec = str(folder / f"{file}.safetensors")
    return AuditedPolicy(GRIDWORLD, name, spec, declared, made_for, floor_at(declared))


def _constant(world: str, action: int) -> QPolicy:
    """Always the same action, as a file whose bytes depend on nothing else."""
    one = make(world)
    bias = np.zeros(one.n_actions, np.float32)
    bias[action] = 1.0
    weight = np.zeros((one.n_actions, one.n_features), np.float32)
    return QPolicy((weight,), (bias,), "relu", 1.0, {"made": "by hand: one action alone"})


def _dial(ground: Ground, seed: int, updates: int, on_stage: StageCallback) -> DialPolicy:
    """The run `online` of the study of the dial, shorter."""
    structure, numbers, clock, _ = RUNS["online"]
    clocked = with_clock(ground, clock)
    world = clocked.table.world
    data = trajectory_datasets(clocked.table, [seed], _EPISODES_EACH)
    structure = dataclasses.replace(structure, one_hot=seen(world), updates=updates)
    run = dataclasses.replace(numbers, seed=seed)
    callbacks = Callbacks(on_report=on_stage("7x7 dial"))
    return train(structure, [run], data, world, callbacks=callbacks).policy(0)
