"""Dials and rules outside the world that they were made for, with and without a front end.

Dials are trained over shifts (`evaluation.road_training.shifted`), the shipped one is not; the mean
of the trained ones' values is a further policy. All drive the same episodes of each shift, on seeds
that no training has seen.
"""

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.measures import Episodes, summary
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.results_folder import as_csv, from_csv
from socialiq.social.angle import exact_weights, score
from socialiq.statistics.intervals import normal_mean
from socialiq.storage import write_atomically
from socialiq.types import Policy, Row
from socialiq.worlds.highway.perception import KNOWN
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.intersection import driving, training
from socialiq_lab.jobs import Inputs, Job, ProgressCallback
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, groups, labelled, mean

RULES = ("go", "wait", "stop_line", "gap_2s", "gap_3s", "gap_4s", "idm")
CELLS = "cells.csv"
OWN = f"{KNOWN},exit=own"
"""Front end of dials that are trained over shifts."""

START = "start"
FIRST_STAGE = "first-stage"
TRAINED = "randomised"
ENSEMBLE = "ensemble"
"""The shipped dial, dials of the first and second stage over shifts, and the mean of the second."""


def trainings(config: Any) -> Iterator[Job]:
    """Yield the jobs of the dials: the shipped one, then two stages for each training seed."""
    yield Job(START, driving.copy_shipped, driving.Shipped(config.start))
    checks = training.Checks(times=4, episodes=200)
    for seed in config.seeds:
        first = f"{FIRST_STAGE}/{seed}"
        second = f"{TRAINED}/{seed}"
        for name, begin, structure, numbers in (
            (first, START, config.structure, config.numbers),
            (second, first, config.further, config.further_numbers),
        ):
            numbers = dataclasses.replace(numbers, seed=seed)
            run: Any = training.DialIterationRun(structure, numbers, checks, shifts=config.training)
            cost = structure.updates / 10
            yield Job(name, training.train_dial_by_iteration, run, (begin,), cost)


@dataclass(frozen=True)
class Driving:
    """Configuration of all episodes of one shift."""

    shift: str
    angles: tuple[float, ...]
    seeds: tuple[int, ...]


class EnsembleDriving(Driving):
    """Configuration of the episodes of all dials as one ensemble."""


def drive(config: Driving, folder: Path, inputs: Inputs, on_progress: ProgressCallback) -> None:
    """Write a row for each driver, front end and angle.

    Args:
        config: Shift, angles in degrees, and seeds of the episodes.
        folder: Folder of the job, to which the rows are written.
        inputs: Folder of each job that makes a dial, by the job's name.
        on_progress: Callback of the finished share, 0 to 1.
    """
    rows = list[Row]()
    driven = list(_drivers(config, inputs))
    for number, (label, policy, front_end, angles) in enumerate(driven):
        world = Intersection().shifted(config.shift, front_end)
        batch = world.batch(min(driving.BATCH, len(config.seeds)))
        episodes = episodes_of(batch, policy, np.array(config.seeds))
        rows += [label | {"angle": angle} | measured(episodes, angle) for angle in angles]
        on_progress((number + 1) / len(driven))
    write_atomically(folder / CELLS, as_csv([{"shift": config.shift} | row for row in rows]))


def _drivers(
    config: Driving, inputs: Inputs
) -> Iterator[tuple[Row, Policy, str, tuple[float, ...]]]:
    """Yield label, policy, front end and the angles at which the episodes count."""
    dials = {name: DialPolicy.load(folder / driving.DIAL) for name, folder in inputs.items()}
    if isinstance(config, EnsembleDriving):
        label: Row = {"driver": ENSEMBLE, "seed": "", "front_end": OWN}
        for angle in config.angles:
            policy = EnsemblePolicy.of([dial.at(angle) for dial in dials.values()])
            yield label, policy, OWN, (angle,)
        return
    for name, dial in dials.items():
        stage, _, seed = name.partition("/")
        fronts = ("", KNOWN) if stage == START else (OWN,)
        for front_end, angle in itertools.product(fronts, config.angles):
            driver = "dial" if stage == START else stage
            label = {"driver": driver, "seed": seed, "front_end": front_end}
            yield label, dial.at(angle), front_end, (angle,)
    for name, front_end in itertools.product(RULES if START in inputs else (), ("", KNOWN)):
        label = {"driver": name, "seed": "", "front_end": front_end}
        yield label, policies.policy(name), front_end, config.angles


def measured(episodes: Episodes, angle: float) -> Row:
    """Return J(α), the shares of endings with 95 % intervals over episodes, and of faults.

    The ego is at fault if it struck another vehicle.

    Args:
        episodes: Episodes of one driver.
        angle: α in degrees.
    """
    row = normal_mean("value", score(exact_weights(angle), episodes.totals))
    row |= summary(episodes, ("collision", "arrival"))
    return row | {"at_fault": float(episodes.at_fault.mean())}


def jobs(config: Any) -> list[Job]:
    """Return the jobs: the dials, then the episodes of each shift.

    Rules drive in the jobs of the shipped dial.
    """
    dials = list(trainings(config))
    seeds = driving.seeds_of_blocks(config.blocks, config.episodes)
    names = [dial.name for dial in dials if not dial.name.startswith(FIRST_STAGE)]
    driven = [(name, Driving, (name,)) for name in names] + [(ENSEMBLE, EnsembleDriving, names[1:])]
    return dials + [
        Job(_driven(name, shift), drive, kind(shift, config.angles, seeds), tuple(inputs), 30)
        for name, kind, inputs in driven
        for shift in config.shifts
    ]


def _driven(driver: str, shift: str) -> str:
    return f"driving/{driver}/{shift}"


def compute_tables(config: Any, context: Context) -> Findings:
    """Return every cell, and for each shift and angle the dials and the best rule.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        Tables `cells` and `compared`, the summary, and the dials of the second stage.
    """
    cells: list[Row] = []
    drivers = [START, *(f"{TRAINED}/{seed}" for seed in config.seeds), ENSEMBLE]
    for shift, driver in itertools.product(config.shifts, drivers):
        cells += from_csv(context.work / _driven(driver, shift) / CELLS)
    compared = [label | _compared(rows) for label, rows in labelled(cells, "shift", "angle")]
    files = {
        f"{TRAINED}-{seed}.safetensors": (
            context.work / TRAINED / str(seed) / driving.DIAL
        ).read_bytes()
        for seed in config.seeds
    }
    return Findings({"cells": cells, "compared": compared}, _summary(compared), files)


def _compared(cells: list[Row]) -> Row:
    """Return J and collisions of the dials at one shift and angle, and the best rule of all."""
    row: Row = {}
    for (driver, front_end), rows in groups(cells, "driver", "front_end").items():
        if driver in RULES:
            continue
        name = f"{driver}_front" if driver == "dial" and front_end else driver
        row[name] = mean(rows, "value")
        row[f"{name}_collision"] = mean(rows, "collision")
        if driver == TRAINED:
            row[f"{name}_collision_largest"] = max(column(rows, "collision"))
    best = max((cell for cell in cells if cell["driver"] in RULES), key=lambda cell: cell["value"])
    rule = best["driver"] + (" with front end" if best["front_end"] else "")
    return row | {"rule": best["value"], "rule_collision": best["collision"], "best_rule": rule}


def _summary(compared: list[Row]) -> dict[str, Any]:
    """Return for each driver the largest collisions and loss at 45 degrees, and cells ahead."""
    summary: dict[str, Any] = {"cells": len(compared)}
    for name in ("dial", "dial_front", TRAINED, ENSEMBLE):
        at_45 = [row for row in compared if row["angle"] == 45.0]
        clean = next((row[name] for row in at_45 if row["shift"] == "none"), None)
        summary[name] = {
            "ahead_of_rules": sum(row[name] > row["rule"] for row in compared),
            "collision_at_45": max((row[f"{name}_collision"] for row in at_45), default=None),
            "loss_at_45": clean and max(clean - row[name] for row in at_45),
        }
    return summary
