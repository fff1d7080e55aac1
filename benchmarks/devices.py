"""Many runs in one program: a GPU beside the processor, in one process.

Two trainings, compilation not counted: the thesis' learner in the 7x7 world with its small network,
and the calibrated learner of the intersection offline, with the network that reads vehicles as a
set. Without a GPU only the processor is measured; `taskset` chooses its cores.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from typing import Any, NamedTuple

import jax
import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.rollout import record, trajectory_datasets
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.train import train
from socialiq.types import Simulator
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make_grid

RUNS = {"crossing7": (1, 32, 512), "intersection_offline": (1, 8)}
CHUNKS = 4  # the first one compiles
EPISODES = 50


class Training(NamedTuple):
    """Settings, demonstrations, the world to act in, if any, and the updates of a chunk."""

    chunk: int
    static: IQLearnConfig
    data: list[Demonstrations]
    world: Simulator | None


def run(repeats: int) -> dict[str, Any]:
    """Measure each device in turn, `repeats` times.

    Returns:
        Updates per second, summed over the runs of a program, by training, number of runs and
        device; medians. Ratios of the GPU to the processor, if there is a GPU.
    """
    devices = {"cpu": jax.devices("cpu")[0], jax.default_backend(): jax.devices()[0]}
    found: dict[str, Any] = {"devices": [str(one.device_kind) for one in devices.values()]}
    for name, training in {"crossing7": _crossing7(), "intersection_offline": _offline()}.items():
        for runs in RUNS[name]:
            rates = {label: [] for label in devices}
            for _ in range(repeats):
                for label, device in devices.items():
                    with jax.default_device(device):
                        rates[label].append(_updates_per_second(training, runs))
            label = f"{name}_{runs}_runs"
            found |= {f"{label}_{one}": statistics.median(rates[one]) for one in devices}
            if "gpu" in devices:
                pairs = zip(rates["gpu"], rates["cpu"], strict=True)
                found[f"{label}_ratio"] = statistics.median(a / b for a, b in pairs)
    return found | {"repeats": repeats}


def _updates_per_second(training: Training, runs: int) -> float:
    """Updates of all runs together per second, after the first, compiling chunk."""
    stamps: list[tuple[int, float]] = []
    callbacks = Callbacks(
        on_report=lambda report: stamps.append((report.done, time.perf_counter()))
    )
    static = dataclasses.replace(training.static, updates=CHUNKS * training.chunk)
    seeds = [IQLearnHyperparameters(seed=seed) for seed in range(runs)]
    train(static, seeds, training.data, training.world, callbacks, training.chunk)
    (first, began), (last, ended) = stamps[0], stamps[-1]
    return runs * (last - first) / (ended - began)


def _crossing7() -> Training:
    world = make_grid("crossing7")
    return Training(50, presets.GRID, trajectory_datasets(tabulate(world), [0], 60), world)


def _offline() -> Training:
    """Episodes of a rule stand for demonstrations: what is in them doesn't change the time."""
    static = dataclasses.replace(presets.offline(presets.INTERSECTION_CALIBRATED), view="set")
    batch, seeds = Intersection().batch(EPISODES), np.arange(EPISODES)
    recorded = record(batch, policies.policy("gap_3s", 0), seeds, "prosocial", {})
    return Training(10, static, [recorded.transitions], None)
