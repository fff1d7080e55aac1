"""Training jobs of the study: demonstrators, dials, the thesis' learner, clones."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import concatenate
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.demonstration_sets import DEMONSTRATIONS
from socialiq.experiments.intersection.jobs import CHECKPOINT, CHUNK, callbacks_of, source_of
from socialiq.experiments.intersection.monitor import Checks, write_curve
from socialiq.experiments.jobs import ProgressCallback
from socialiq.learners import behaviour_cloning as cloning
from socialiq.learners.collect import Collector, soft
from socialiq.learners.dial import config as dial
from socialiq.learners.dial.acting import acting
from socialiq.learners.dial.train import dial_of
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.dqn import config as dqn
from socialiq.learners.dqn.train import train as train_dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.nn.q_network import network_of
from socialiq.storage import read_json
from socialiq.studies.intersection_skill.demonstrations import demonstrations
from socialiq.studies.intersection_skill.driving import DIAL, drive, policy_name
from socialiq.studies.intersection_skill.inference import ANGLES
from socialiq.studies.intersection_skill.skill import told
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection


@dataclass(frozen=True)
class ExpertRun:
    """A demonstrator: a DQN on R(α) + c h."""

    structure: dqn.StaticConfig
    numbers: dqn.Hyperparameters
    weight: float
    """c."""
    environments: int = 12
    options: Options = field(default_factory=Options)


def train_expert(
    config: ExpertRun, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train; writes the policy."""
    structure, numbers, world = config.structure, config.numbers, Intersection(config.options)
    steps = CHUNK * structure.steps_per_update
    source = source_of(config.options, config.environments, steps)
    trained = train_dqn(
        structure,
        [numbers],
        [told(source, config.weight, numbers.angle)],
        (world.n_features, world.n_actions),
        callbacks_of(folder, None, on_progress),
        CHUNK,
    )
    trained.policy(0).save(folder / policy_name(numbers.angle))
    (folder / CHECKPOINT).unlink(missing_ok=True)


@dataclass(frozen=True)
class DialRun:
    """One dial; a job of which one input is the demonstrations, another inferred angles if any."""

    structure: dial.StaticConfig
    numbers: dial.Hyperparameters
    size: int
    weight: float
    """c of the score by which it is looked at; it is not told."""
    steps_per_update: int = 12
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=lambda: Checks(times=8, episodes=200))


def train_family(
    config: DialRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train a dial; writes it and its learning curve."""
    structure, numbers = _told_angles(config.structure, inputs), config.numbers
    world = Intersection(config.options)
    source = source_of(config.options, config.environments, CHUNK * config.steps_per_update)
    trained = train_dial(
        structure,
        [numbers],
        _datasets(structure, inputs, config.size, numbers.seed),
        sizes=(world.n_features, world.n_actions),
        callbacks=callbacks_of(folder, lambda state: _looked(config, state), on_progress),
        chunk=CHUNK,
        before_chunk=Collector([source], [numbers.seed], acting(structure, [numbers])),
    )
    trained.policy(0).save(folder / DIAL)
    write_curve(trained.history, folder / "curve.csv")
    (folder / CHECKPOINT).unlink(missing_ok=True)


def _told_angles(structure: dial.StaticConfig, inputs: Mapping[str, Path]) -> dial.StaticConfig:
    """The demonstrators' angles that were inferred, in the place of their own."""
    for folder in inputs.values():
        if (folder / ANGLES).is_file():
            found = tuple(row["angle"] for row in read_json(folder / ANGLES))
            return dataclasses.replace(structure, demonstrators=found)
    return structure


def _datasets(
    structure: dial.StaticConfig, inputs: Mapping[str, Path], size: int, seed: int
) -> list[Demonstrations]:
    """None, a set of each demonstrator, or all in one."""
    if not structure.demonstrations:
        return []
    shown = demonstrations(inputs[DEMONSTRATIONS], size, seed)
    return list(shown.values()) if structure.demonstrators else [concatenate(list(shown.values()))]


def _looked(config: DialRun, state: Any) -> dict[str, np.ndarray]:
    """Mean of R(α) + c h over the demonstrated angles; NaN where no check is due."""
    done = math.ceil(int(state.optimiser.count[0]) / CHUNK)
    if not config.checks.due(done, math.ceil(config.structure.updates / CHUNK)):
        return {"total": np.array([np.nan])}
    family = dial_of(config.structure, config.numbers, network_of(state.target_network.values, 0))
    first, count = config.checks.first_seed, config.checks.episodes
    seeds, batch = np.arange(first, first + count), Batch(config.options, min(count, 256))
    scores = [
        drive(batch, family.at(angle), seeds).score(angle, config.weight).mean()
        for angle in MODES.values()
    ]
    return {"total": np.array([np.mean(scores)])}


@dataclass(frozen=True)
class ReturnsRun:
    """The thesis' learner, one run for each angle, all in one program."""

    structure: iq.StaticConfig
    numbers: tuple[iq.Hyperparameters, ...]
    size: int
    environments: int = 12
    options: Options = field(default_factory=Options)


def train_returns(
    config: ReturnsRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train; writes a policy for each angle."""
    structure, numbers = config.structure, config.numbers
    seed = numbers[0].seed
    steps = CHUNK * structure.env_steps_per_update
    sources = [source_of(config.options, config.environments, steps) for _ in numbers]
    behaviour = soft([one.temperature for one in numbers])
    trained = train_iq(
        structure,
        numbers,
        [concatenate(list(demonstrations(inputs[DEMONSTRATIONS], config.size, seed).values()))],
        callbacks=callbacks_of(folder, None, on_progress),
        chunk=CHUNK,
        before_chunk=Collector(sources, [one.seed for one in numbers], behaviour),
    )
    for run, one in enumerate(numbers):
        trained.policy(run).save(folder / policy_name(one.angle))
    (folder / CHECKPOINT).unlink(missing_ok=True)


@dataclass(frozen=True)
class CloneRun:
    """A clone of each demonstrator."""

    structure: cloning.StaticConfig
    size: int
    seed: int


def train_clones(
    config: CloneRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Clone; writes a policy for each demonstrated angle."""
    shown = demonstrations(inputs[DEMONSTRATIONS], config.size, config.seed)
    numbers = [
        cloning.Hyperparameters(seed=config.seed, dataset=place) for place in range(len(MODES))
    ]
    callbacks = callbacks_of(folder, None, on_progress)
    cloned = cloning.clone(config.structure, numbers, list(shown.values()), callbacks, CHUNK)
    for run, angle in enumerate(MODES.values()):
        cloned.policy(run).save(folder / policy_name(angle))
    (folder / CHECKPOINT).unlink(missing_ok=True)
