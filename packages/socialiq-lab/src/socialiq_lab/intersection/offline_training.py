"""Training jobs of the intersection from mixtures of demonstrations, many runs in one program.

Each run has its training seed, of its mixture too. Its policy is in a folder of its own below the
job's (`run_file`), so that other jobs can name it as their driver.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.road_training import CHUNK, soft_collector
from socialiq.evaluation.rollout import MODES
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import offline
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.learners.kernel import Trained
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.options import Options
from socialiq_lab.intersection.demonstration_sets import MIXTURE, mixture_of
from socialiq_lab.intersection.driving import DIAL, LAST
from socialiq_lab.jobs import ProgressCallback


def run_file(seed: int, angle: float | None = None) -> str:
    """Return the place of a run's policy below its job's folder; a dial has no angle."""
    return f"{seed}/{DIAL}" if angle is None else f"{seed}/{angle:g}/{LAST}"


@dataclass(frozen=True, kw_only=True)
class OfflineDialRuns:
    """Offline dials, each on a mixture of the three experts' demonstrations."""

    structure: dial.OfflineDialConfig
    numbers: dial.OfflineDialHyperparameters
    seeds: tuple[int, ...]
    size: int
    """Transitions of each expert."""
    mixture: str = MIXTURE


def train_offline_dials(
    config: OfflineDialRuns, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train the three stages of all dials and write them."""
    numbers = [replace(config.numbers, seed=seed) for seed in config.seeds]

    def callbacks(stage: str) -> Callbacks:
        before = offline.STAGES.index(stage)
        return Callbacks(
            lambda report: on_progress((before + report.done / report.total) / len(offline.STAGES))
        )

    stages = offline.train(config.structure, numbers, _mixtures(config, inputs), callbacks)
    for run, seed in enumerate(config.seeds):
        _save(stages["dial"], run, folder / run_file(seed))


@dataclass(frozen=True, kw_only=True)
class AngleRuns:
    """Runs of one method, for each training seed and each angle."""

    structure: Any
    numbers: Any
    """Without seed, angle and data set."""
    seeds: tuple[int, ...]
    angles: tuple[float, ...]
    size: int
    """Transitions of each expert."""
    mixture: str = MIXTURE

    def runs(self, datasets_by_angle: bool = False) -> list[Any]:
        """Return the hyperparameters of each run, by seed and then angle."""
        return [
            replace(self.numbers, seed=seed, angle=angle, dataset=run if datasets_by_angle else of)
            for run, ((of, seed), angle) in enumerate(
                itertools.product(enumerate(self.seeds), self.angles)
            )
        ]

    def save(self, trained: Trained, folder: Path) -> None:
        """Write the policy of each run.

        Raises:
            UserError: If a run broke.
        """
        if trained.failures:
            raise UserError(trained.failures[0])
        for run, (seed, angle) in enumerate(itertools.product(self.seeds, self.angles)):
            _save(trained, run, folder / run_file(seed, angle))


@dataclass(frozen=True, kw_only=True)
class CloneRuns(AngleRuns):
    """Behaviour clones."""

    structure: bc.CloningConfig
    numbers: bc.CloningHyperparameters
    nearest: bool = False
    """Whether a run sees the demonstrator of the nearest angle alone."""


def train_clones(
    config: CloneRuns, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train clones and write their networks."""
    datasets = _mixtures(config, inputs)
    if config.nearest:
        pairs = itertools.product(datasets, config.angles)
        datasets = [_of_the_nearest(data, angle) for data, angle in pairs]
    runs = config.runs(datasets_by_angle=config.nearest)
    callbacks = Callbacks(lambda report: on_progress(report.done / report.total))
    config.save(bc.BehaviourCloning.train_on(config.structure, runs, datasets, callbacks), folder)


def _of_the_nearest(data: Demonstrations, angle: float) -> Demonstrations:
    """Return the episodes of the demonstrator whose angle is nearest."""
    nearest = min(MODES, key=lambda mode: abs(MODES[mode] - angle))
    number = data.mode_names.index(nearest)
    return data.select(np.flatnonzero(np.asarray(data.episode_modes) == number))


@dataclass(frozen=True, kw_only=True)
class IQLearnRuns(AngleRuns):
    """IQ-Learn, offline, or online beside a mixture."""

    structure: iq.IQLearnConfig
    numbers: iq.IQLearnHyperparameters
    environments: int = 12
    options: Options = field(default_factory=Options)


def train_iq_learn(
    config: IQLearnRuns, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train IQ-Learn and write the last networks."""
    structure, runs = config.structure, config.runs()
    collector = None
    if structure.online:
        steps = structure.env_steps_per_update
        collector = soft_collector(config.options, config.environments, steps, runs)
    callbacks = Callbacks(lambda report: on_progress(report.done / report.total))
    datasets = _mixtures(config, inputs)
    trained = train_iq(
        structure, runs, datasets, callbacks=callbacks, chunk=CHUNK, before_chunk=collector
    )
    config.save(trained, folder)


def _mixtures(
    config: OfflineDialRuns | AngleRuns, inputs: Mapping[str, Path]
) -> Sequence[Demonstrations]:
    """Return the mixture of each training seed."""
    (recordings,) = inputs.values()
    return [mixture_of(recordings, config.mixture, config.size, seed) for seed in config.seeds]


def _save(trained: Trained, run: int, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    trained.policy(run).save(file)


@dataclass(frozen=True)
class AtlasMember:
    """A policy of the atlas."""

    name: str
    sha256: str
    """Of its file: another atlas gives another policy."""


def copy_of_atlas(
    config: AtlasMember, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a policy of the atlas, so that other jobs can evaluate it."""
    atlas.load(config.name).save(folder / LAST)
    on_progress(1.0)
