"""Dials of two angles at the intersection with crosswalks, and the price of a shield.

A dial is trained by policy iteration from none. The same episodes without the ego show what it
costs vehicles; the seconds that people wait for it are counted by sub-step.
"""

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.evaluation import road_training
from socialiq.learners import policy_iteration
from socialiq.worlds.intersection.options import CrosswalkOptions
from socialiq.worlds.registry import make
from socialiq_lab.intersection.driving import DIAL, seeds_of_blocks, shipped_dials
from socialiq_lab.intersection.effects import (
    EffectsRun,
    effects_of,
    effects_row,
    measure_effects,
)
from socialiq_lab.intersection.training import first_dial
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, callbacks_of
from socialiq_lab.study import Context, Findings

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


def train(config: Training, folder: Path, _inputs: Inputs, on_progress: ProgressCallback) -> None:
    """Train a dial and write it.

    Args:
        config: World, static configuration and numbers of the dial.
        folder: Folder of the job, to which the dial is written.
        on_progress: Callback of the finished share, 0 to 1.
    """
    structure, labeller, sizes = road_training.of_crosswalks(
        config.structure, make(config.world), ENVIRONMENTS
    )
    trained = policy_iteration.train(
        structure, [config.numbers], [labeller], sizes, callbacks_of(on_progress)
    )
    trained.policy(0).save(folder / DIAL)


def measures_in(world: str) -> tuple[str, ...]:
    """Return the names of what is measured in a world.

    Raises:
        UserError: If no people walk in the world.
    """
    options = make(world).options
    if not isinstance(options, CrosswalkOptions):
        raise UserError(f"no people walk in {world}: choose a world with crosswalks")
    signals = (f"signal_{name}" for name in options.signals)
    return "r_env", "delay", "braking", *signals, "collision", "arrival"


def jobs(config: Any) -> list[Job]:
    """Return the jobs: train a dial of each seed, drive it, and drive others with a shield."""
    structure = replace(
        road_training.CROSSWALK,
        updates=config.updates,
        states_per_update=config.states_per_update,
    )
    measures = measures_in(config.world)
    seeds = seeds_of_blocks((config.first_episode,), config.episodes)
    turns = tuple(
        f"@{angle:g}/{class_angle:g}"
        for class_angle in config.class_angles
        for angle in config.angles
    )
    driving = EffectsRun(turns, measures, seeds, config.world)
    listed = shipped_dials({"blind": BLIND})
    for seed in config.seeds:
        numbers = replace(road_training.CROSSWALK_NUMBERS, seed=seed)
        run = Training(config.world, structure, numbers)
        listed.append(Job(f"training/{seed}", train, run, (), 400.0))
        listed.append(Job(f"driving/{seed}", measure_effects, driving, (f"training/{seed}",), 60.0))
    drivers = tuple(name if name in RULES else f"@{name}" for name in config.shielded)
    shielding = replace(driving, drivers=drivers, shields=(0.0, config.shield))
    return [*listed, Job("shields", measure_effects, shielding, ("dials/blind",), 20.0)]


def compute_tables(config: Any, context: Context) -> Findings:
    """Return what dials cause at each pair of angles, and drivers with and without a shield.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        Tables `prices` and `shields`, the largest shares of hits as summary, and the first seed's
        dial.
    """
    names = measures_in(config.world)
    runs = [effects_of(context.work / f"driving/{seed}") for seed in config.seeds]
    cells = itertools.product(config.class_angles, config.angles)
    prices = [
        {"class_angle": class_angle, "angle": angle}
        | effects_row(names, [run[number, 0] for run in runs])
        for number, (class_angle, angle) in enumerate(cells)
    ]
    driven = effects_of(context.work / "shields")
    shields = [
        {"driver": name if name in RULES else f"blind dial at {name}", "shield": seconds}
        | effects_row(names, [driven[row, column]])
        for row, name in enumerate(config.shielded)
        for column, seconds in enumerate((0.0, config.shield))
    ]
    hits = [name for name in prices[0] if name.endswith("_hit")]
    summary = {
        "largest_hit": max(row[name] for row in prices for name in hits),
        "largest_hit_of_a_seed": max(row[f"{name}_largest"] for row in prices for name in hits),
    }
    tables = {"prices": prices, "shields": shields}
    return Findings(tables, summary, first_dial(config, context))
