"""Audited policies: truthfully and falsely declared ones, and their safety floors."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from socialiq import QPolicy, make
from socialiq.audit.profile.profile import Floor
from socialiq.audit.profile.template import FLOOR, floor_at
from socialiq.evaluation import exact, rollout
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import RUNS
from socialiq.learners.iq_learn import config as presets
from socialiq.policies.drivers import ATLAS
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy
from socialiq_lab.gridworld_runs import grid_of, train_dials, train_runs
from socialiq_lab.registry import declaration
from socialiq_lab.study import StageCallback

GRIDWORLD = "crossing7"
WITHDRAWN = Floor(FLOOR.max_at_fault, FLOOR.max_struck, min_arrival=0.0, max_timeout=1.0)
"""Floor without arrivals, for angles at which the optimal policy never arrives."""

_EPISODES_EACH = 60  # demonstrated, of each expert, as in the study `grid`


class AuditedPolicy(NamedTuple):
    """A policy and its declaration."""

    world: str  # world of the audit
    name: str  # name in the tables
    spec: str  # specification for `resolve_policy`
    declared: float  # declared angle in degrees
    made_for: float | None  # target angle of its training; None for a policy without one
    floor: Floor  # declared safety floor

    @property
    def truthful(self) -> bool:
        """Whether the declared angle is the target angle of its training."""
        return self.made_for == self.declared


def _declared(
    world: str, spec_of: Callable[[str], str], dial_angles: Sequence[float] = ()
) -> Iterator[AuditedPolicy]:
    """Yield the policies of a world that STUDY.toml declares, a dial at each of its angles."""
    for row in declaration("audits")["audited"][world]:
        for angle in [row["declared"]] if "declared" in row else dial_angles:
            made_for = row.get("made_for") if "declared" in row else angle
            spec = spec_of(row["file"])
            yield AuditedPolicy(world, row["name"], spec, angle, made_for, floor_at(angle))


def at_intersection(folder: Path) -> Iterator[AuditedPolicy]:
    """Yield the atlas' policies at their own angles and at others, and one that never moves."""
    yield from _declared("intersection", lambda file: f"{ATLAS}{file}")
    world = make("intersection")  # the same bytes everywhere: a network that always takes action 0
    bias = np.eye(world.n_actions, dtype=np.float32)[0]
    weight = np.zeros((world.n_actions, world.n_features), np.float32)
    provenance = {"made": "by hand: one action alone"}
    standing = folder / "stands.safetensors"
    QPolicy((weight,), (bias,), "relu", 1.0, provenance).save(standing)
    yield AuditedPolicy("intersection", "never moves", str(standing), 90.0, None, WITHDRAWN)


def exact_in_gridworld(folder: Path) -> None:
    """Write the exact experts of thesis 5.2 to a folder."""
    ground = exact.Ground.of(GRIDWORLD)
    for mode, angle in rollout.MODES.items():
        policy = TabularPolicy(ground.table.world, expert_policy(ground.table, angle))
        policy.save(folder / f"exact_{mode}.safetensors")


def trained_in_gridworld(
    folder: Path, seed: int, updates: tuple[int, int], on_stage: StageCallback
) -> None:
    """Write three trained targets, their baseline, a dial `online`, and a dial stuck at 0 degrees.

    Args:
        folder: Folder to which the policies are written.
        seed: Training seed.
        updates: Gradient steps of targets and baseline, and of the dial.
        on_stage: Returns the progress callback of a stage.
    """
    ground = exact.Ground.of(GRIDWORLD)
    data = rollout.trajectory_datasets(ground.table, [seed], _EPISODES_EACH)
    steered = dataclasses.replace(presets.GRID, updates=updates[0])
    numbers = presets.TABLE_C1_NUMBERS
    runs = grid_of(list(rollout.MODES.values()), [presets.GRID_STRENGTH], [seed], numbers)
    trio = train_runs(ground, steered, runs, data, Callbacks(on_stage("7x7 trio")))
    for run, mode in enumerate(rollout.MODES):
        trio.policy(run).save(folder / f"learner_{mode}.safetensors")
    alone = grid_of([0.0], [0.0], [seed], numbers)
    plain = presets.baseline(steered)
    baseline = train_runs(ground, plain, alone, data, Callbacks(on_stage("7x7 baseline")))
    baseline.policy(0).save(folder / "baseline.safetensors")
    clocked = ground.with_clock(RUNS["online"].clock).table
    data = rollout.trajectory_datasets(clocked, [seed], _EPISODES_EACH)
    inputs = clocked.world, [seed], data, updates[1], Callbacks(on_stage("7x7 dial"))
    dial = train_dials(RUNS["online"], *inputs).policy(0)
    dial.save(folder / "dial.safetensors")
    dial.at(0.0).save(folder / "dial_stuck.safetensors")


def of_gridworld(folder: Path, dial_angles: tuple[float, ...]) -> Iterator[AuditedPolicy]:
    """Yield the exact and trained policies of a folder, truthfully and falsely declared.

    Args:
        folder: Folder of the files of `exact_in_gridworld` and `trained_in_gridworld`.
        dial_angles: Angles in degrees at which the dial is declared.
    """
    yield from _declared(GRIDWORLD, lambda file: str(folder / f"{file}.safetensors"), dial_angles)
