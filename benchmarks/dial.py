"""Cost of a dial beside one run of the thesis' learner, in the same process.

In the 7x7 world all as they are committed: the dials have other networks, batches and updates, and
what the quick one reaches is measured too. In the intersection both at one budget: network, rows
and steps of the calibrated preset.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from socialiq.demonstrations.mixture import MIXTURES
from socialiq.evaluation.dial import sweep
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.road_training import CHUNK, source_of
from socialiq.evaluation.rollout import record, trajectory_datasets
from socialiq.learners.acting import dials, soft
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Behaviour, Collector
from socialiq.learners.dial.config import (
    QUICK,
    RUNS,
    SHORT,
    DialConfig,
    DialHyperparameters,
    DialPreset,
)
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make_grid
from socialiq_lab.comparison_runs import Arena, Run, dial_settings
from studies.compare_priors.study import DIAL_RATES
from studies.dial.study import KEY_ANGLES

SHARE = 10  # a tenth of each run's updates is timed, compilation not counted
EPISODES_EACH = 60
QUICK_SEEDS = (50, 51, 52, 53, 54, 55, 56, 57, 58, 59)
"""Of the quick dial's regret. 0 to 9 and 40 to 49 were used in development, 30 to 39 elsewhere."""
DRIVERS = {"egoistic": "go", "prosocial": "gap_3s", "altruistic": "wait"}
"""Rules whose episodes stand for demonstrations: what is in them doesn't change the time."""

Trains = Callable[[int, Callbacks, int], Any]
"""Trains for so many updates, in chunks of so many."""


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        Medians by name: seconds of whole runs, and ratios.
    """
    sides = {
        "crossing7": (_grid_thesis(), _grid_dial(RUNS["online"])),
        "crossing7_short": (_grid_thesis(), _grid_dial(SHORT)),
        "crossing7_quick": (_grid_thesis(), _grid_dial(QUICK)),
        "intersection": _intersection(),
    }
    found: dict[str, Any] = {}
    for name, (thesis, dial) in sides.items():
        pairs = [(_seconds(*thesis), _seconds(*dial)) for _ in range(repeats)]
        found |= {
            f"{name}_thesis_updates": thesis[1],
            f"{name}_thesis_seconds": statistics.median(pair[0] for pair in pairs),
            f"{name}_dial_updates": dial[1],
            f"{name}_dial_seconds": statistics.median(pair[1] for pair in pairs),
            f"{name}_ratio": statistics.median(b / a for a, b in pairs),
        }
    regrets = _quick_regrets()
    quick = {
        "crossing7_quick_regret": statistics.mean(regrets),
        "crossing7_quick_worst_seed": max(regrets),
    }
    return found | quick | {"repeats": repeats}


def _seconds(trains: Trains, updates: int) -> float:
    """Seconds of a run, from a part of it after its first, compiling chunk."""
    stamps: list[tuple[int, float]] = []
    callbacks = Callbacks(
        on_report=lambda report: stamps.append((report.done, time.perf_counter()))
    )
    part = max(updates // SHARE, 4 * CHUNK)
    trains(part, callbacks, CHUNK)
    (first, began), (last, ended) = stamps[0], stamps[-1]
    return (ended - began) * updates / (last - first)


def _grid_thesis() -> tuple[Trains, int]:
    """One run of the thesis' 7x7 study."""
    world = make_grid("crossing7")
    data = trajectory_datasets(tabulate(world), [0], EPISODES_EACH)

    def trains(updates: int, callbacks: Callbacks, chunk: int) -> Any:
        shorter = dataclasses.replace(presets.GRID, updates=updates)
        return train_iq(shorter, [presets.TABLE_C1_NUMBERS], data, world, callbacks, chunk)

    return trains, presets.GRID.updates


def _grid_dial(run: DialPreset, seeds: Sequence[int] = (0,)) -> tuple[Trains, int]:
    """A dial of the 7x7 world, with its clock; one for each seed, in one program."""
    world = make_grid("crossing7").with_clock()
    data = trajectory_datasets(tabulate(world), seeds, EPISODES_EACH)
    hyperparameters = [
        dataclasses.replace(run.numbers, seed=seed, dataset=number)
        for number, seed in enumerate(seeds)
    ]

    def trains(updates: int, callbacks: Callbacks, chunk: int) -> Any:
        shorter = dataclasses.replace(run.structure, one_hot=world.one_hot, updates=updates)
        return train_dial(shorter, hyperparameters, data, world, callbacks=callbacks, chunk=chunk)

    return trains, run.structure.updates


def _quick_regrets() -> list[float]:
    """Of the quick dial by seed: exact greedy regret, the mean over 0, 15, ..., 90 degrees."""
    ground = Ground.of("crossing7").with_clock(clock=True)
    trains, updates = _grid_dial(QUICK, QUICK_SEEDS)
    trained = trains(updates, Callbacks(), CHUNK)
    regrets = []
    for run in range(len(QUICK_SEEDS)):
        found = sweep(trained.policy(run), ground.part, "greedy")
        by_angle = dict(zip(found.angles, found.regrets(ground.optimum.attainable), strict=True))
        regrets.append(float(np.mean([by_angle[angle] for angle in KEY_ANGLES])))
    return regrets


def _intersection() -> tuple[tuple[Trains, int], tuple[Trains, int]]:
    """The calibrated preset, and a dial of the same network, rows and steps."""
    base, rates = presets.INTERSECTION_CALIBRATED, presets.INTERSECTION_CALIBRATED_NUMBERS
    options = Options()
    shown = {
        mode: record(
            Intersection(options).batch(64), policies.policy(driver, 0), np.arange(200), mode, {}
        ).transitions
        for mode, driver in DRIVERS.items()
    }
    data = [MIXTURES["equal_trajectories"](shown, 100, 0)]
    run = Run(0.0, 0, 0, (("strength", rates.strength),))
    own = DialConfig(), DialHyperparameters(final_rate=1.0)
    arena = Arena(base, rates, base.updates, data)
    dial_config, hyperparameters = dial_settings(arena, *own, run, DIAL_RATES)

    def collector(behaviour: Behaviour) -> Collector:
        source = source_of(options, 12, base.env_steps_per_update)
        return Collector([source], [0], behaviour)

    def thesis(updates: int, callbacks: Callbacks, chunk: int) -> Any:
        shorter = dataclasses.replace(base, updates=updates)
        acts = collector(soft([rates.temperature]))
        return train_iq(shorter, [rates], data, None, callbacks, chunk, acts)

    def dial(updates: int, callbacks: Callbacks, chunk: int) -> Any:
        shorter = dataclasses.replace(dial_config, updates=updates)
        acts = collector(dials(shorter, [hyperparameters]))
        return train_dial(
            shorter, [hyperparameters], data, callbacks=callbacks, chunk=chunk, before_chunk=acts
        )

    return (thesis, base.updates), (dial, base.updates)
