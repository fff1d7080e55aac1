"""Training jobs of the intersection: experts, learners and dials; each fills a folder.

A job is called in a process of its own, so everything that it depends on is in its configuration,
of which its fingerprint is made (`socialiq_lab.jobs`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.road_training import (
    CHUNK,
    MEASURES,
    STEPS_PER_UPDATE,
    Checks,
    Monitor,
    dial_collector,
    dial_labeller,
    observes_time,
    sizes_of,
    soft_collector,
    source_of,
)
from socialiq.learners import dqn, policy_iteration
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import train as dial_training
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.learners.kernel import Trained
from socialiq.learners.state import History
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.results_folder import as_csv
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Policy, Row
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Batch, Intersection
from socialiq_lab.intersection.demonstration_sets import MIXTURE, mixture_of
from socialiq_lab.intersection.driving import BEST, CURVE, DIAL, LAST
from socialiq_lab.jobs import ProgressCallback

CHECKPOINT = "checkpoint.safetensors"


def fit(
    train: Callable[..., Trained],
    folder: Path,
    on_progress: ProgressCallback,
    files: Sequence[str],
    monitor: Monitor | None = None,
) -> None:
    """Train, from the checkpoint of an interrupted try if there is one, and write the outcome.

    Args:
        train: Trains, given `callbacks` and `chunk`.
        folder: Folder to fill.
        on_progress: Called with the share that is done.
        files: Name of the file of each run's policy.
        monitor: Measures for the learning curve; none is written without it.
    """
    checkpoint = folder / CHECKPOINT
    callbacks = Callbacks(
        lambda report: on_progress(report.done / report.total),
        monitor,
        checkpoint,
        checkpoint.is_file(),
    )
    trained = train(callbacks=callbacks, chunk=CHUNK)
    for run, file in enumerate(files):
        trained.policy(run).save(folder / file)
    if monitor is not None:
        write_atomically(folder / CURVE, as_csv(curve_rows(trained.history)))
    checkpoint.unlink(missing_ok=True)


def curve_rows(history: History) -> list[Row]:
    """Return the checked points of the first run: updates, loss terms, measured values."""
    arrays = {name: history.array(name)[:, 0] for name in history.values}
    return [
        {"updates": updates} | {name: rounded(float(array[i])) for name, array in arrays.items()}
        for i, updates in enumerate(history.updates)
        if np.isfinite(arrays["total"][i])
    ]


@dataclass(frozen=True)
class ExpertRun:
    """One DQN expert (thesis 5.2)."""

    structure: dqn.DQNConfig
    numbers: dqn.DQNHyperparameters
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=Checks)


def train_expert(
    config: ExpertRun, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the last network of an expert, the best by checks, and the learning curve."""
    structure, numbers = config.structure, config.numbers

    def measure(state: Any, done: int) -> dict[str, float]:
        policy = dqn.policy_of(structure, numbers, network_of(state.network, 0))
        measures = config.checks.measured(config.options, policy, numbers.angle)
        check = {"updates": done, "total": measures["total"], "episodes": config.checks.episodes}
        _keep_best(policy, check, folder / BEST)
        return measures

    source = source_of(config.options, config.environments, structure.steps_per_update)
    train = partial(dqn.train, structure, [numbers], [source], sizes_of(config.options))
    monitor = config.checks.monitor(structure.updates, measure, *MEASURES)
    fit(train, folder, on_progress, [LAST], monitor)


def _keep_best(policy: QPolicy, made: Row, file: Path) -> None:
    """Write the policy if none was better; of two equal ones the earlier stays."""
    if file.is_file() and QPolicy.load(file).provenance["check"]["total"] >= made["total"]:
        return
    dataclasses.replace(policy, provenance={**policy.provenance, "check": made}).save(file)


@dataclass(frozen=True)
class LearnerRun:
    """One IQ-Learn run on a mixture of the three experts' demonstrations."""

    structure: iq.IQLearnConfig
    numbers: iq.IQLearnHyperparameters
    mixture: str
    size: int
    """Episodes of each mode, or transitions in a mixture of equal transitions."""
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=lambda: Checks(times=10))


def train_learner(
    config: LearnerRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the last network of a learner and its learning curve."""
    structure, numbers = config.structure, config.numbers
    (recordings,) = inputs.values()
    data = mixture_of(recordings, config.mixture, config.size, numbers.seed)

    def measure(state: Any, _done: int) -> dict[str, float]:
        policy = QPolicy.of(network_of(state.network, 0), numbers.temperature, {})
        return config.checks.measured(config.options, policy, numbers.angle)

    collector = None
    if structure.online:
        steps = structure.env_steps_per_update
        collector = soft_collector(config.options, config.environments, steps, [numbers])
    train = partial(train_iq, structure, [numbers], [data], before_chunk=collector)
    monitor = config.checks.monitor(structure.updates, measure, *MEASURES)
    fit(train, folder, on_progress, [LAST], monitor)


DIAL_STRUCTURE = dial.DialConfig(
    view="set", hidden=(128, 128), updates=40_000, replay_capacity=200_000, environments=12
)
"""Static config of dials and agents, without ranges and updates: network of the set experts."""

DIAL_NUMBERS = dial.DialHyperparameters(
    temperature=0.03, discount=0.99, learning_rate=5e-4, final_rate=0.03, exploration=0.05
)
"""Rates of the set experts; an intersection has no clock, hence their discount."""


@dataclass(frozen=True, kw_only=True)
class DialRun:
    """One dial, or an agent: a dial of one angle."""

    structure: dial.DialConfig
    numbers: dial.DialHyperparameters
    size: int
    """Transitions of each expert."""
    steps_per_update: int = STEPS_PER_UPDATE
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=lambda: Checks(times=8, episodes=200))
    check_angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Angles of a check, in degrees; of an agent its own."""

    @property
    def clock(self) -> bool:
        """Whether the network sees the time: that is where times are redrawn."""
        return self.structure.redraw_times > 0


@dataclass(frozen=True, kw_only=True)
class MixtureDialRun(DialRun):
    """A dial that learns from a mixture of the three experts' demonstrations."""

    mixture: str = MIXTURE


def train_dial(
    config: MixtureDialRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a dial and its learning curve, which is of J(α)."""
    (recordings,) = inputs.values()
    data = mixture_of(recordings, config.mixture, config.size, config.numbers.seed)
    if config.clock:
        data = data.with_clock()

    def value(batch: Batch, policy: Policy, seeds: np.ndarray, angle: float) -> float:
        return episodes_of(batch, policy, seeds).metrics().value(angle)

    fit_dial(config, [data], value, folder, on_progress)


def fit_dial(
    config: DialRun,
    data: Sequence[Demonstrations],
    value: Callable[[Batch, Policy, np.ndarray, float], float],
    folder: Path,
    on_progress: ProgressCallback,
) -> None:
    """Train a dial on demonstrations and on the core; write it and its learning curve.

    Args:
        config: Configuration of the run.
        data: Sets of demonstrations, if any.
        value: Mean value of a policy's episodes on some seeds at an angle; a check measures its
            mean over angles.
        folder: Folder to fill.
        on_progress: Called with the share that is done.
    """
    structure, numbers = config.structure, config.numbers

    def measure(state: Any, _done: int) -> dict[str, float]:
        network = network_of(dial_training.deployed(state), 0)
        policy = dial_training.dial_of(structure, numbers, network)
        batch, seeds = config.checks.batch(config.options), config.checks.seeds
        values = [value(batch, policy.at(angle), seeds, angle) for angle in config.check_angles]
        return {"total": float(np.mean(values))}

    steps = config.steps_per_update
    world = Intersection(config.options)
    collector = dial_collector(structure, [numbers], world, config.environments, steps)
    train = partial(
        dial_training.train,
        structure,
        [numbers],
        data,
        sizes=sizes_of(config.options, config.clock),
        before_chunk=collector,
    )
    monitor = config.checks.monitor(structure.updates, measure, "total")
    fit(train, folder, on_progress, [DIAL], monitor)


@dataclass(frozen=True)
class DialIterationRun:
    """One run of direct policy iteration of a dial, which begins with the job's input."""

    structure: policy_iteration.DialIterationConfig
    numbers: policy_iteration.IterationHyperparameters
    environments: int = 256
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=lambda: Checks(times=8, episodes=200))
    check_angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Angles of a check, in degrees."""


def train_dial_by_iteration(
    config: DialIterationRun,
    folder: Path,
    inputs: Mapping[str, Path],
    on_progress: ProgressCallback,
) -> None:
    """Improve the dial of the input; write it and its learning curve, which is of J(α)."""
    (begun,) = inputs.values()
    start = DialPolicy.load(begun / DIAL)
    clock = observes_time(start, config.options)
    structure, numbers = policy_iteration.with_network_of(config.structure, start), config.numbers

    def measure(state: Any, _done: int) -> dict[str, float]:
        network = network_of(state.target_network, 0)
        policy = DialPolicy.of(network, 1.0, structure.low, structure.high, {})
        values = [
            config.checks.measured(config.options, policy.at(angle), angle)["total"]
            for angle in config.check_angles
        ]
        return {"total": float(np.mean(values))}

    labeller = dial_labeller(structure, config.options, config.environments, clock)
    fitting = partial(
        policy_iteration.train,
        structure,
        [numbers],
        [labeller],
        sizes_of(config.options, clock),
        start=start,
    )
    monitor = config.checks.monitor(structure.updates, measure, "total")
    fit(fitting, folder, on_progress, [DIAL], monitor)
