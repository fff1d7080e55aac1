"""Training of a recipe's dials of all seeds in one compiled program, and the dial of each seed."""

from __future__ import annotations

import dataclasses
import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.play import episodes_of
from socialiq.experiments.intersection.demonstration_sets import mixture_of
from socialiq.experiments.intersection.episodes import CURVE, DIAL
from socialiq.experiments.intersection.fitting import (
    CHECKPOINT,
    CHUNK,
    Monitor,
    curve_rows,
    sizes_of,
)
from socialiq.experiments.intersection.training import MixtureDialRun, dial_collector
from socialiq.experiments.jobs import ProgressCallback
from socialiq.experiments.results import as_csv
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import train as dial_training
from socialiq.nn.q_network import network_of
from socialiq.storage import write_atomically


@dataclass(frozen=True, kw_only=True)
class DialPrograms(MixtureDialRun):
    """Dials of one recipe, each of a training seed and with a mixture of its own.

    Attributes:
        seeds: Training seeds; `numbers.seed` has no use.
    """

    seeds: tuple[int, ...]

    @property
    def runs(self) -> list[dial.Hyperparameters]:
        """Return the numbers of each run."""
        return [
            dataclasses.replace(self.numbers, seed=seed, dataset=number)
            for number, seed in enumerate(self.seeds)
        ]


def train_dials(
    config: DialPrograms, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write each seed's dial and its learning curve, `SEED.safetensors` and `SEED.csv`."""
    (recordings,) = inputs.values()
    data = [mixture_of(recordings, config.mixture, config.size, seed) for seed in config.seeds]
    if config.clock:
        data = [one.with_clock() for one in data]
    environments, steps = config.environments, config.steps_per_update
    collector = dial_collector(config.structure, config.runs, config.options, environments, steps)
    checkpoint = folder / CHECKPOINT
    callbacks = Callbacks(
        lambda report: on_progress(report.done / report.total),
        _monitor(config),
        checkpoint,
        checkpoint.is_file(),
    )
    trained = dial_training.train(
        config.structure,
        config.runs,
        data,
        sizes=sizes_of(config.options, config.clock),
        callbacks=callbacks,
        chunk=CHUNK,
        before_chunk=collector,
    )
    for run, seed in enumerate(config.seeds):
        trained.policy(run).save(folder / f"{seed}.safetensors")
        write_atomically(folder / f"{seed}.csv", as_csv(curve_rows(trained.history, run)))
    checkpoint.unlink(missing_ok=True)


def _monitor(config: DialPrograms) -> Monitor:
    """Return what measures the mean J(α) over the angles of the checks, of each run."""
    runs, checks = config.runs, config.checks
    chunks = math.ceil(config.structure.updates / CHUNK)

    def value(state: Any, run: int) -> float:
        made = partial(dial_training.dial_of, config.structure, runs[run])
        policy = made(network_of(dial_training.deployed(state), run))
        batch = checks.batch(config.options)
        values = [
            episodes_of(batch, policy.at(angle), checks.seeds).metrics().value(angle)
            for angle in config.check_angles
        ]
        return float(np.mean(values))

    def after_chunk(state: Any) -> dict[str, np.ndarray]:
        done = int(state.optimiser.count[0])
        if not checks.due(math.ceil(done / CHUNK), chunks):
            return {"total": np.full(len(runs), np.nan)}
        return {"total": np.array([value(state, run) for run in range(len(runs))])}

    return after_chunk


@dataclass(frozen=True)
class DialOfSeed:
    """The dial of one of a program's seeds."""

    seed: int


def pick_dial(
    config: DialOfSeed, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Copy a seed's dial and its learning curve out of a program's folder."""
    (trained,) = inputs.values()
    shutil.copy(trained / f"{config.seed}.safetensors", folder / DIAL)
    shutil.copy(trained / f"{config.seed}.csv", folder / CURVE)
    on_progress(1.0)
