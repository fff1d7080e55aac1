"""What a dial costs beside one run of the thesis' learner, in the same process.

In the 7x7 world both as they are committed: the dial has other network, batch and updates. In the
intersection both at one budget: network, rows and steps of the calibrated preset.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from socialiq.demonstrations.mixture import MIXTURES
from socialiq.evaluation.record import record
from socialiq.learners.collect import Behaviour, Collector, soft
from socialiq.learners.dial.acting import acting
from socialiq.learners.dial.config import Numbers
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.learners.outside import Outside
from socialiq.thesis import presets
from socialiq.thesis.dial.config import RUNS, seen
from socialiq.thesis.experts import trajectory_datasets
from socialiq.thesis.intersection.stages import source_of
from socialiq.thesis.priors.learners import Lane, dial_numbers, dial_structure
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.registry import make_grid

SHARE = 10  # a tenth of each run's updates is timed, compilation not counted
CHUNK = 200
DRIVERS = {"egoistic": "go", "prosocial": "gap_3s", "altruistic": "wait"}
"""Rules whose episodes stand for demonstrations: what is in them doesn't change the time."""

Trains = Callable[[int, Outside, int], Any]
"""Trains for so many updates, in chunks of so many."""


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        Medians by name: seconds of whole runs, and ratios.
    """
    grid, junction = _grid(), _intersection()
    found: dict[str, Any] = {}
    for world, (thesis, dial) in {"crossing7": grid, "intersection": junction}.items():
        pairs = [(_seconds(*thesis), _seconds(*dial)) for _ in range(repeats)]
        ours = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        found |= {
            f"{world}_thesis_updates": thesis[1],
            f"{world}_thesis_seconds": statistics.median(ours[0]),
            f"{world}_dial_updates": dial[1],
            f"{world}_dial_seconds": statistics.median(ours[1]),
            f"{world}_ratio": statistics.median(b / a for a, b in pairs),
        }
    return found | {"repeats": repeats}


def _seconds(trains: Trains, updates: int) -> float:
    """Seconds of a run, from a part of it after its first, compiling chunk."""
    stamps: list[tuple[int, float]] = []
    outside = Outside(on_report=lambda report: stamps.append((report.done, time.perf_counter())))
    part = max(updates // SHARE, 4 * CHUNK)
    trains(part, outside, CHUNK)
    (first, began), (last, ended) = stamps[0], stamps[-1]
    return (ended - began) * updates / (last - first)


def _grid() -> tuple[tuple[Trains, int], tuple[Trains, int]]:
    """One run of the thesis' 7x7 study, and the online dial."""
    plain = make_grid("crossing7")
    clocked = plain.with_clock()
    data, clocked_data = (
        trajectory_datasets(tabulate(world), [0], 60) for world in (plain, clocked)
    )
    online = RUNS["online"]
    structure = dataclasses.replace(online.structure, one_hot=seen(clocked))

    def thesis(updates: int, outside: Outside, chunk: int) -> Any:
        shorter = dataclasses.replace(presets.GRID, updates=updates)
        return train_iq(shorter, [presets.TABLE_C1_NUMBERS], data, plain, outside, chunk)

    def dial(updates: int, outside: Outside, chunk: int) -> Any:
        shorter = dataclasses.replace(structure, updates=updates)
        return train_dial(
            shorter, [online.numbers], clocked_data, clocked, outside=outside, chunk=chunk
        )

    return (thesis, presets.GRID.updates), (dial, structure.updates)


def _intersection() -> tuple[tuple[Trains, int], tuple[Trains, int]]:
    """The calibrated preset, and a dial of the same network, rows and steps."""
    base, rates = presets.INTERSECTION_CALIBRATED, presets.INTERSECTION_CALIBRATED_NUMBERS
    options = Options()
    shown = {
        mode: record(
            Batch(options, 64), policies.policy(driver, 0), np.arange(200), mode, {}
        ).transitions
        for mode, driver in DRIVERS.items()
    }
    data = [MIXTURES["equal_trajectories"](shown, 100, 0)]
    numbers: Numbers = dial_numbers(rates, Lane(0.0, rates.strength, 0, 0))

    def collector(behaviour: Behaviour) -> Collector:
        source = source_of(options, 12, CHUNK * base.env_steps_per_update)
        return Collector([source], [0], behaviour)

    def thesis(updates: int, outside: Outside, chunk: int) -> Any:
        shorter = dataclasses.replace(base, updates=updates)
        acts = collector(soft([rates.temperature]))
        return train_iq(shorter, [rates], data, None, outside, chunk, acts)

    def dial(updates: int, outside: Outside, chunk: int) -> Any:
        shorter = dataclasses.replace(dial_structure(base), updates=updates)
        acts = collector(acting(shorter, [numbers]))
        return train_dial(shorter, [numbers], data, outside=outside, chunk=chunk, before_chunk=acts)

    return (thesis, base.updates), (dial, base.updates)
