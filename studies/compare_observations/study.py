"""Two observations with equal labels, each in its own training: what they are worth in driving.

A dial is trained by policy iteration from no policy. It visits states of its own episodes, and
every action of a state is followed in a copy of the simulator. One dial observes rows of vehicles
and the time, with each vehicle's closest approach (view `set_ahead`); the other the ego's route
(`worlds.highway.observation`, view `set`). Networks, losses and numbers of labels are equal.
"""

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import world as world_of
from socialiq.evaluation import road_training
from socialiq.evaluation.episodes import episodes_of
from socialiq.learners import policy_iteration
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import read_json, write_json
from socialiq.types import Row
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, callbacks_of
from socialiq_lab.study import Context, Findings

DRIVEN = "driven.json"
ENVIRONMENTS = 256
VIEWS = {"rows": "set_ahead", "route": "set"}
MEASURES = ("total", "r_env", "r_social", "arrival", "collision", "timeout")


@dataclass(frozen=True)
class Training:
    """Configuration of one dial, and of the episodes that it drives."""

    world: str
    observation: str
    seed: int
    updates: int
    states_per_update: int
    angles: tuple[float, ...]
    episodes: int
    first_episode: int


def train(config: Training, folder: Path, _inputs: Inputs, on_progress: ProgressCallback) -> None:
    """Train a dial, drive it at each angle on fresh episodes, write both.

    Args:
        config: World, observation, seed and sizes.
        folder: Folder of the job.
        on_progress: Callback of the finished share, 0 to 1.
    """
    world: Any = world_of(f"{config.world},observation={config.observation}")
    clock = config.observation == "rows"
    structure = replace(
        road_training.CROSSWALK,
        classes=False,
        view=VIEWS[config.observation],
        times=world.options.decisions if clock else 0,
        updates=config.updates,
        states_per_update=config.states_per_update,
    )
    numbers = replace(road_training.CROSSWALK_NUMBERS, seed=config.seed)
    labeller = road_training.dial_labeller(structure, world, ENVIRONMENTS, clock)
    sizes = world.n_features + clock, world.n_actions
    callbacks = callbacks_of(on_progress, share=0.9)
    trained = policy_iteration.train(structure, [numbers], [labeller], sizes, callbacks)
    dial = trained.policy(0)
    dial.save(folder / "dial.safetensors")
    write_json(folder / DRIVEN, driven(dial, world, config))


def driven(dial: DialPolicy, world: Any, config: Training) -> list[Row]:
    """Return the outcome of greedy episodes at each angle.

    Args:
        dial: The dial.
        world: Its world.
        config: Angles and episodes.

    Returns:
        A row for each angle: J(α), mean totals of both rewards, and shares of endings.
    """
    seeds = config.first_episode + np.arange(config.episodes)
    rounds = road_training.CROSSWALK.first_rounds
    labels = (config.updates + rounds * road_training.CHUNK) * config.states_per_update
    rows = []
    for angle in config.angles:
        metrics = episodes_of(world.batch(ENVIRONMENTS), dial.at(angle), seeds).metrics()
        measures = {name: getattr(metrics, name) for name in MEASURES[1:]}
        place = {"world": config.world, "observation": config.observation, "seed": config.seed}
        rows.append(
            place | {"angle": angle, "total": metrics.value(angle)} | measures | {"labels": labels}
        )
    return rows


def jobs(config: Any) -> list[Job]:
    """Return a job for each world, observation and training seed."""
    shared = (config.updates, config.states_per_update, config.angles, config.episodes)
    cells = itertools.product(config.worlds, config.observations, config.seeds)
    return [
        Job(
            f"training/{number}",
            train,
            Training(world, observation, seed, *shared, config.first_episode),
            (),
            300.0,
        )
        for number, (world, observation, seed) in enumerate(cells)
    ]


def compute_tables(config: Any, context: Context) -> Findings:
    """Return the outcome of each dial at each angle, and means over training seeds.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        Tables `driven` and `means`; the gain of the route in J(α) and the mean share of collisions
        of each observation as summary.
    """
    rows = [row for job in jobs(config) for row in read_json(context.work / job.name / DRIVEN)]
    means = []
    for world, angle, observation in itertools.product(
        config.worlds, config.angles, config.observations
    ):
        place = {"world": world, "angle": angle, "observation": observation}
        cell = [row for row in rows if place.items() <= row.items()]
        mean = {name: float(np.mean([row[name] for row in cell])) for name in MEASURES}
        means.append(place | mean | {"labels": cell[0]["labels"]})
    summary: dict[str, Any] = {
        f"collision_{observation}": float(
            np.mean([row["collision"] for row in means if row["observation"] == observation])
        )
        for observation in config.observations
    }
    return Findings({"driven": rows, "means": means}, summary, {})
