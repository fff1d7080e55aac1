"""Jobs of the dial's study; every one fills a folder (experiments/jobs.py)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.demonstrations import files
from socialiq.demonstrations.mixture import MIXTURES
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.play import episodes_of
from socialiq.experiments.intersection.episodes import save_episodes
from socialiq.experiments.intersection.jobs import (
    BATCH,
    CHECKPOINT,
    CHUNK,
    EPISODES,
    FIRST_EPISODE,
    LAST,
    callbacks_of,
    source_of,
)
from socialiq.experiments.intersection.monitor import Checks, write_curve
from socialiq.experiments.jobs import ProgressCallback
from socialiq.learners.collect import Collector
from socialiq.learners.dial.acting import acting
from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.learners.dial.train import dial_of, train
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import network_of
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

DIAL = "dial.safetensors"

STRUCTURE = StaticConfig(
    view="set", hidden=(128, 128), updates=40_000, replay_capacity=200_000, environments=12
)
"""Static config of dials and agents, without ranges and updates: network of the set experts."""


NUMBERS = Hyperparameters(
    temperature=0.03, discount=0.99, learning_rate=5e-4, final_rate=0.03, exploration=0.05
)
"""Rates of the set experts; an intersection has no clock, hence their discount."""


@dataclass(frozen=True)
class DialRun:
    """One dial, or an agent: a dial of one angle."""

    structure: StaticConfig
    numbers: Hyperparameters
    mixture: str
    size: int
    """Transitions of each expert."""
    steps_per_update: int = 12
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=lambda: Checks(times=8, episodes=200))
    check_angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    """At which it is looked at; of an agent its own."""


def train_dial(
    config: DialRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Mix demonstrations, train on them and on the core, keep the target network and the curve."""
    structure, numbers, world = config.structure, config.numbers, Intersection(config.options)
    (pools,) = inputs.values()
    shown = {mode: files.load(pools / f"{mode}.safetensors") for mode in MODES}
    data = MIXTURES[config.mixture](shown, config.size, numbers.seed)
    source = source_of(config.options, config.environments, CHUNK * config.steps_per_update)
    trained = train(
        structure,
        [numbers],
        [data],
        sizes=(world.n_features, world.n_actions),
        callbacks=callbacks_of(folder, lambda state: _looked(config, state), on_progress),
        chunk=CHUNK,
        before_chunk=Collector([source], [numbers.seed], acting(structure, [numbers])),
    )
    trained.policy(0).save(folder / DIAL)
    write_curve(trained.history, folder / "curve.csv")
    (folder / CHECKPOINT).unlink(missing_ok=True)


def _looked(config: DialRun, state: Any) -> dict[str, np.ndarray]:
    """J(α) at α, the mean over the angles looked at; NaN where no check is due."""
    done = math.ceil(int(state.optimiser.count[0]) / CHUNK)
    if not config.checks.due(done, math.ceil(config.structure.updates / CHUNK)):
        return {"total": np.array([np.nan])}
    dial = dial_of(config.structure, config.numbers, network_of(state.target_network.values, 0))
    first, count = config.checks.first_seed, config.checks.episodes
    totals = [
        episodes_of(
            Batch(config.options, min(count, 256)), dial.at(angle), np.arange(first, first + count)
        )
        .metrics()
        .value(angle)
        for angle in config.check_angles
    ]
    return {"total": np.array([np.mean(totals)])}


@dataclass(frozen=True)
class Turning:
    """Episodes of a dial at some angles, on seeds that all policies share."""

    angles: tuple[float, ...]
    episodes: int = EPISODES
    first_seed: int = FIRST_EPISODE
    options: Options = field(default_factory=Options)


def drive(
    config: Turning, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Drive greedily; writes what became of every episode, one file for each angle."""
    (trained,) = inputs.values()
    dial = DialPolicy.load(trained / DIAL)
    seeds = np.arange(config.first_seed, config.first_seed + config.episodes)
    for number, angle in enumerate(config.angles, start=1):
        episodes = episodes_of(Batch(config.options, BATCH), dial.at(angle), seeds)
        save_episodes(folder / file_of(angle), episodes)
        on_progress(number / len(config.angles))


@dataclass(frozen=True)
class Turned:
    """A dial turned to one angle, as a policy that other jobs can evaluate."""

    angle: float


def turn(
    config: Turned, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the policy of one angle."""
    (trained,) = inputs.values()
    DialPolicy.load(trained / DIAL).at(config.angle).save(folder / LAST)
    on_progress(1.0)


def file_of(angle: float) -> str:
    """Return the file name of the episodes at an angle."""
    return f"{angle:g}.safetensors"
