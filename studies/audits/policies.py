"""Audited policies: truthfully and falsely declared ones, and their safety floors."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from socialiq.audit.profile.profile import Floor
from socialiq.audit.profile.template import FLOOR
from socialiq.audit.request import ATLAS
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.rollout import MODES, trajectory_datasets
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import RUNS
from socialiq.learners.dial.train import train
from socialiq.learners.iq_learn import config as presets
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.worlds.enumerate import TabularPolicy, expert_policy
from socialiq.worlds.registry import make
from socialiq_lab.gridworld_runs import grid_of, train_runs
from socialiq_lab.study import StageCallback

GRIDWORLD = "crossing7"
WITHDRAWN = Floor(FLOOR.max_at_fault, FLOOR.max_struck, min_arrival=0.0, max_timeout=1.0)
"""Floor without arrivals, for angles at which the optimal policy never arrives."""

_EPISODES_EACH = 60  # demonstrated, of each expert, as in the study `grid`
_NEARLY_90 = 75.0  # degrees


def floor_at(angle: float) -> Floor:
    """Return the default floor; beyond 75 degrees arrivals are not required."""
    return WITHDRAWN if angle > _NEARLY_90 else FLOOR


class AuditedPolicy(NamedTuple):
    """A policy and its declaration.

    Attributes:
        world: World of the audit.
        name: Name in the tables.
        spec: Specification for `resolve_policy`.
        declared: Declared angle in degrees.
        made_for: Target angle of its training; None for a policy without one.
        floor: Declared safety floor.
    """

    world: str
    name: str
    spec: str
    declared: float
    made_for: float | None
    floor: Floor

    @property
    def truthful(self) -> bool:
        """Whether the declared angle is the target angle of its training."""
        return self.made_for == self.declared


def at_intersection(folder: Path) -> Iterator[AuditedPolicy]:
    """Yield the atlas' policies at their own angles, some at others, and one that never moves.

    Args:
        folder: Folder for the file of the policy that never moves.
    """
    families = {"set expert": "set_", "expert": "expert_", "learner": ""}
    for family, prefix in families.items():
        for mode, angle in MODES.items():
            yield _of_atlas(f"{family}, {mode}", f"{prefix}{mode}", angle, angle)
    yield _of_atlas("learner without a prior", "baseline", 45.0, None)
    yield _of_atlas("set expert, egoistic", "set_egoistic", 45.0, 0.0)
    yield _of_atlas("expert, egoistic", "expert_egoistic", 45.0, 0.0)
    yield _of_atlas("set expert, prosocial", "set_prosocial", 90.0, 45.0)
    standing = folder / "stands.safetensors"
    _constant("intersection", 0).save(standing)
    yield AuditedPolicy("intersection", "never moves", str(standing), 90.0, None, WITHDRAWN)


def exact_in_gridworld(folder: Path) -> None:
    """Write the exact experts of thesis 5.2 to a folder."""
    ground = Ground.of(GRIDWORLD)
    for mode, angle in MODES.items():
        policy = TabularPolicy(ground.table.world, expert_policy(ground.table, angle))
        policy.save(folder / f"exact_{mode}.safetensors")


def trained_in_gridworld(
    folder: Path, seed: int, updates: tuple[int, int], on_stage: StageCallback
) -> None:
    """Train three targets with their baseline, and a dial, and write them to a folder.

    Args:
        folder: Folder of the files.
        seed: Seed of the trainings and of their demonstrations.
        updates: Gradient steps of the targets and of the dial.
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
    """Yield the exact and trained policies of a folder, truthfully and falsely declared."""
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
    """Return a policy that always takes the same action; its file has the same bytes everywhere."""
    policies = make(world)
    bias = np.zeros(policies.n_actions, np.float32)
    bias[action] = 1.0
    weight = np.zeros((policies.n_actions, policies.n_features), np.float32)
    return QPolicy((weight,), (bias,), "relu", 1.0, {"made": "by hand: one action alone"})


def _dial(ground: Ground, seed: int, updates: int, on_stage: StageCallback) -> DialPolicy:
    """Train the run `online` of the study `dial` with fewer updates."""
    static, numbers, clock, _ = RUNS["online"]
    clocked = ground.with_clock(clock)
    world = clocked.table.world
    data = trajectory_datasets(clocked.table, [seed], _EPISODES_EACH)
    static = dataclasses.replace(static, one_hot=world.one_hot, updates=updates)
    run = dataclasses.replace(numbers, seed=seed)
    callbacks = Callbacks(on_report=on_stage("7x7 dial"))
    return train(static, [run], data, world, callbacks=callbacks).policy(0)
