"""A junction as `data world` makes them, of columns that are computed here, without recordings.

Two cars drive east and two drive north through one conflict area, where those to the east give way;
a person and a cyclist cross, and one line is closed for a while. So no extra is needed.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from tests.digest.batches import CHANGED, actions_in, followed
from tests.digest.digest import Hashes, Item, of_array, of_arrays, of_plain
from tests.digest.rollouts import SEEDS, Always, evidence_in, of_columns, of_effects
from tests.digest.traces import traced

LENGTH = 120  # m of a way, which has a point every metre; the ways cross in the middle
ENTRY = LENGTH / 2 - 3.0  # m, begin of the conflict area on either way
EXIT = LENGTH / 2 + 3.0
SPEED = 8.0  # m/s, of everybody that was recorded
ENTERS = (0, 25, 10, 40)  # sub-steps, 0.1 s, at which the cars were seen first
STATES = 100
EAST = (0, 1)
"""Numbers of the cars that drive east; the others drive north."""


def ways() -> np.ndarray:
    """Return x and y in m, direction in rad and largest speed in m/s of each car's way."""
    along = np.arange(LENGTH + 1) - LENGTH / 2
    zero = np.zeros_like(along)
    fast = np.full_like(along, 14.0)
    east = np.stack([along, zero, zero, fast], axis=1)
    north = np.stack([zero, along, zero + np.pi / 2, fast], axis=1)
    return np.concatenate([east, east, north, north])


def pairs() -> dict[str, np.ndarray]:
    """Return the conflict areas of each pair of cars, and where one is in the other's way."""
    area_of = []
    stretches = []
    first = [0]
    yields = []
    for car in range(4):
        for other in range(4):
            crosses = (car in EAST) != (other in EAST)
            area_of.append(len(yields) if crosses else -1)
            if crosses:
                yields.append(1 if car in EAST else -1)
            elif car != other:
                stretches.append([0.0, float(LENGTH), 0.0, float(LENGTH)])
            first.append(len(stretches))
    areas = len(yields)
    return {
        "pair_first": np.array([0, 16]),
        "area_of": np.array(area_of),
        "area": np.tile([ENTRY, EXIT, ENTRY, EXIT], (areas, 1)),
        "area_yields": np.array(yields),
        "area_merges": np.zeros(areas, np.int64),
        "stretch_first": np.array(first),
        "stretch": np.array(stretches),
        "closed_first": np.array([0, 0, 0, 0, 1]),
        "closed": np.array([[ENTRY - 12.0, 5.0, 9.0]]),
    }


def people() -> dict[str, np.ndarray]:
    """Return a person on foot and a cyclist, who cross the way to the east."""
    steps = np.arange(STATES) / 10
    walks = np.stack([0 * steps - 14.0, 1.4 * steps - 6.0, 0 * steps + np.pi / 2, 0 * steps + 1.4])
    rides = np.stack([0 * steps - 24.0, 8.0 - 4.0 * steps, 0 * steps - np.pi / 2, 0 * steps + 4.0])
    return {
        "person_first": np.array([0, 2]),
        "person_class": np.array([5, 4]),
        "person_size": np.array([[0.5, 0.5], [1.8, 0.6]]),
        "person_step": np.array([10, 20]),
        "person_state_first": np.array([0, STATES, 2 * STATES]),
        # In the order of a file's columns: Numba would compile the core again for another order.
        "person_state": np.ascontiguousarray(np.concatenate([walks.T, rides.T])),
    }


def made_junction(**changes: Any) -> Any:
    """Return the world; `changes` are of its fields."""
    from socialiq_recordings.world.config import WorldConfig
    from socialiq_recordings.world.recorded_world import RecordedWorld, Road

    cars = len(ENTERS)
    seconds = np.arange(STATES) / 10
    state = np.stack([5.0 + SPEED * seconds, np.full(STATES, SPEED)], axis=1)
    columns = {
        "recording_first": np.array([0, cars]),
        "identity": np.arange(cars) + 10,
        "length": np.full(cars, 4.5),
        "width": np.full(cars, 1.8),
        "arrival": np.full(cars, EXIT + 10.0),
        "origin": np.full(cars, ENTRY),
        "zone": np.tile([ENTRY - 20.0, ENTRY], (cars, 1)),
        "egos": np.arange(cars),
        "line_first": (LENGTH + 1) * np.arange(cars + 1),
        "line": ways(),
        "state_first": STATES * np.arange(cars + 1),
        "state_step": np.array(ENTERS),
        "state": np.tile(state, (cars, 1)),
        "drivers": np.array(
            [
                [10.0, 1.0, 8.0, 12.0],
                [1.5, 0.3, 1.0, 2.0],
                [2.0, 0.3, 1.0, 3.0],
                [2.0, 0.3, 1.0, 3.0],
                [2.5, 0.3, 1.5, 3.5],
                [1.5, 0.2, 1.0, 2.0],
            ]
        ),
    }
    road = Road(**columns, **pairs(), **people())
    return dataclasses.replace(RecordedWorld(road, WorldConfig(), 12.0, {}), **changes)


def side_by_side(_folder: Path) -> Hashes:
    """Follow episodes of the junction side by side."""
    return followed(made_junction())


def caused(_folder: Path) -> Hashes:
    """Follow the junction whose social reward is what the ego causes, and measure its drivers."""
    from socialiq.evaluation.effects import measure, measuring, summary

    world = measuring(made_junction())
    hashes = followed(world)
    for rule in world.drivers:
        effects = measure(world, Always(world.driver(rule).action), SEEDS)
        hashes[f"driver_{rule}"] = of_plain([of_columns(of_effects(effects)), summary(effects)])
    return hashes


def evidence(_folder: Path) -> Hashes:
    """Hash the evidence of an audit at the junction."""
    return evidence_in(made_junction())


def written(folder: Path) -> Path:
    """Write the junction to a file; return its path."""
    path = folder / "junction.safetensors"
    made_junction().save(path)
    return path


def saved(folder: Path) -> Hashes:
    """Hash the columns of the junction's file, and an episode of the world that is read from it."""
    from safetensors.numpy import load_file

    path = written(folder)
    return {
        "file": of_arrays(load_file(path), True),
        **traced("socialiq/RecordedJunction-v0", {"file": str(path), "clock": True}, 60),
    }


def by_name(folder: Path) -> Hashes:
    """Hash rates of decisions and options of the file's world, which commands open by its name."""
    from socialiq.worlds.registry import open_world

    world: Any = open_world(str(written(folder)))
    batch = world.batch(2)
    batch.reset(0)
    draw = actions_in(world, (2,))
    seen = [batch.step(draw()).observation for _ in range(int(5 / CHANGED))]
    sizes = [world.n_features, world.n_actions, world.whole_episode, list(world.drivers)]
    return {"observations": of_array(np.array(seen), True), "sizes": of_plain(sizes)}


ITEMS = [
    Item("world/recorded-junction", side_by_side, quick=True),
    Item("world/recorded-junction-caused", caused, quick=True),
    Item("world/recorded-junction-by-name", by_name, quick=True),
    Item("evidence/recorded-junction", evidence, quick=True),
    Item("saved/recorded-junction", saved, quick=True),
]
