"""Dials of two angles at the intersection with crosswalks, and the price of a shield.

A dial is trained by policy iteration from none. The same episodes without the ego show what it
costs vehicles; the seconds that people wait for it are counted by sub-step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.cli.drivers import driver_of
from socialiq.errors import UserError
from socialiq.evaluation import road_training
from socialiq.evaluation.effects import measure, measuring
from socialiq.evaluation.measures import Episodes
from socialiq.learners import policy_iteration
from socialiq.nn.class_dial import ClassDial
from socialiq.types import Policy, Row
from socialiq.worlds.intersection.options import CrosswalkOptions
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make
from socialiq_lab.intersection.driving import DIAL, shipped_dials
from socialiq_lab.intersection.training import first_dial
from socialiq_lab.jobs import Job, ProgressCallback, callbacks_of
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import over_seeds

BLIND = "intersection-dial-clock/iterated.safetensors"
"""Dial of the intersection, which observes the vehicles alone."""
ENVIRONMENTS = 256
RULES = ("go", "gap_3s", "idm")


@dataclass(frozen=True)
class Training:
    """Configuration of one dial."""

    world: str
    structure: policy_iteration.DialIterationConfig
    numbers: policy_iteration.IterationHyperparameters


@dataclass(frozen=True)
class Driving:
    """Configuration of the episodes of one dial."""

    world: str
    angles: tuple[float, ...]
    class_angles: tuple[float, ...]
    first_episode: int
    episodes: int


@dataclass(frozen=True)
class Shielding:
    """Configuration of the episodes with and without a shield."""

    world: str
    drivers: tuple[str, ...]
    first_episode: int
    episodes: int
    shield: float


def train(
    config: Training, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train a dial and write it.

    Args:
        config: World, static configuration and numbers of the dial.
        folder: Folder of the job, to which the dial is written.
        on_progress: Callback of the finished share, 0 to 1.
    """
    structure, labeller, sizes = road_training.of_crosswalks(
        config.structure, _world(config.world), ENVIRONMENTS
    )
    trained = policy_iteration.train(
        structure, [config.numbers], [labeller], sizes, callbacks_of(on_progress)
    )
    trained.policy(0).save(folder / DIAL)


def drive(
    config: Driving, folder: Path, inputs: Mapping[str, Path], _on_progress: ProgressCallback
) -> None:
    """Drive a dial at each pair of angles; write (class angle, angle, episode, measure).

    Args:
        config: World, angles in degrees, and episodes.
        folder: Folder of the job, to which the array is written.
        inputs: Folder of the job that trained the dial.
    """
    (trained,) = inputs.values()
    dial = ClassDial.load(trained / DIAL)
    driven = _driver(config)
    rows = [
        [driven(dial.of_class(class_angle).at(angle)) for angle in config.angles]
        for class_angle in config.class_angles
    ]
    np.save(folder / "measures.npy", np.array(rows))


def shield(
    config: Shielding, folder: Path, inputs: Mapping[str, Path], _on_progress: ProgressCallback
) -> None:
    """Drive each driver without and with a shield; write (driver, shield, episode, measure).

    Args:
        config: World, drivers, episodes, and the shield's time in s.
        folder: Folder of the job, to which the array is written.
        inputs: Folder of the dial that observes the vehicles alone.
    """
    (blind,) = inputs.values()
    world = _world(config.world)
    rows = list[Any]()
    driven = _driver(config)
    for name in config.drivers:
        rule = name in world.drivers
        driver, angle = (name, None) if rule else (str(blind / DIAL), float(name))
        with driver_of(driver, world, angle) as loaded:
            rows.append([driven(loaded.policy, shield=seconds) for seconds in (0.0, config.shield)])
    np.save(folder / "measures.npy", np.array(rows))


def _world(name: str) -> Intersection:
    world = make(name)
    assert isinstance(world, Intersection)
    return world


def signals_of(world: Intersection) -> tuple[str, ...]:
    """Return the signals of the people that a world has.

    Raises:
        UserError: If no people walk in the world.
    """
    options = world.options
    if not isinstance(options, CrosswalkOptions):
        raise UserError(f"no people walk in {world.name}: choose a world with crosswalks")
    return options.signals


def measures_in(name: str) -> tuple[str, ...]:
    """Return the names of what is measured in a world."""
    return "r_env", "delay", "braking", *signals_of(_world(name)), "collision", "arrival"


def _driver(config: Driving | Shielding) -> Any:
    """Return what drives a policy on seeded episodes, which share the worlds without the ego."""
    world = measuring(_world(config.world))
    seeds = np.arange(config.first_episode, config.first_episode + config.episodes)
    signals = signals_of(world)
    driven = partial(measure, world, seeds=seeds, begun={}, judging=False)

    def measured(policy: Policy, **options: Any) -> np.ndarray:
        return measures_of(driven(policy=policy, **options), signals)

    return measured


def measures_of(effects: Episodes, signals: Sequence[str]) -> np.ndarray:
    """Return `measures_in` of each episode, (episode, measure).

    Args:
        effects: Effects of a driver on its episodes.
        signals: Names of the signals of people.

    Returns:
        Columns in the order of `measures_in`; an episode in which a person is hit does not count as
        a collision.
    """
    hit = sum(effects[name] for name in signals if name.endswith("_hit"))
    columns = (
        effects.r_env,
        effects.delay,
        effects.braking,
        *(effects[f"signal_{name}"] for name in signals),
        effects.collision & (hit == 0),
        effects.arrival,
    )
    return np.column_stack(columns)


def jobs(config: Any) -> list[Job]:
    """Return the jobs: train a dial of each seed, drive it, and drive others with a shield."""
    structure = replace(
        road_training.CROSSWALK,
        updates=config.updates,
        states_per_update=config.states_per_update,
    )
    size = {"first_episode": config.first_episode, "episodes": config.episodes}
    driving = Driving(config.world, config.angles, config.class_angles, **size)
    listed = shipped_dials({"blind": BLIND})
    for seed in config.seeds:
        numbers = replace(road_training.CROSSWALK_NUMBERS, seed=seed)
        listed.append(
            Job(f"training/{seed}", train, Training(config.world, structure, numbers), (), 400.0)
        )
        listed.append(Job(f"driving/{seed}", drive, driving, (f"training/{seed}",), 60.0))
    shielding = Shielding(config.world, config.shielded, **size, shield=config.shield)
    return [*listed, Job("shields", shield, shielding, ("dials/blind",), 20.0)]


def compute_tables(config: Any, context: Context) -> Findings:
    """Return what dials cause at each pair of angles, and drivers with and without a shield.

    Args:
        config: Anyuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        Tables `prices` and `shields`, the largest shares of hits as summary, and the first seed's
        dial.
    """
    names = measures_in(config.world)
    runs = [np.load(context.work / f"driving/{seed}/measures.npy") for seed in config.seeds]
    prices = [
        {"class_angle": class_angle, "angle": angle}
        | measured_row(names, [run[row, column] for run in runs])
        for row, class_angle in enumerate(config.class_angles)
        for column, angle in enumerate(config.angles)
    ]
    driven = np.load(context.work / "shields/measures.npy")
    shields = [
        {"driver": name if name in RULES else f"blind dial at {name}", "shield": seconds}
        | measured_row(names, [driven[row, column]])
        for row, name in enumerate(config.shielded)
        for column, seconds in enumerate((0.0, config.shield))
    ]
    hits = [name for name in names if name.endswith("_hit")]
    summary = {
        "largest_hit": max(row[name] for row in prices for name in hits),
        "largest_hit_of_a_seed": max(row[f"{name}_largest"] for row in prices for name in hits),
    }
    tables = {"prices": prices, "shields": shields}
    return Findings(tables, summary, first_dial(config, context))


def measured_row(names: Sequence[str], runs: Sequence[np.ndarray]) -> Row:
    """Return means over training seeds, intervals over episodes, and ranges over seeds.

    Args:
        names: Names of the measures.
        runs: Measures of each training seed, (episode, measure).

    Returns:
        Numbers of seeds and episodes, and for each measure its mean and the suffixes `_low`,
        `_high`, `_least` and `_largest`.
    """
    row: Row = {"seeds": len(runs), "episodes": len(runs[0])}
    for column, name in enumerate(names):
        row |= over_seeds(name, [run[:, column] for run in runs])
    return row
