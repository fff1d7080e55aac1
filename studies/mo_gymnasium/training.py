"""Our methods, and the job that trains one of them on a task with several seeds and evaluates it.

Dials act in a Gymnasium environment: with a network of values where actions are discrete, else with
actor and critics.
"""

import dataclasses
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import UserError, rollout_env
from socialiq.learners.acting import Driver, drawing
from socialiq.learners.collect import Collector, from_env
from socialiq.learners.continuous import config
from socialiq.learners.continuous import train as actors
from socialiq.learners.continuous.standardise import EXPLORED, Standardisation, explored
from socialiq.learners.dial import train as dials
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.iq_learn.config import Endings
from socialiq.provenance import versions
from socialiq.storage import write_atomically
from socialiq.worlds.environment import action_size, sizes
from socialiq_lab.jobs import ProgressCallback
from studies.mo_gymnasium.tasks import ANGLES, FOLDER, TASKS, Piece, Task

DIAL, EXPERTS = "dial", "experts"
STANDARDISED = "dial, standardised"
RETIRED = "dial from demonstrations", "IQ-Learn trio"
"""Methods whose pieces are read and whose training has retired (docs/reproduction)."""
METHODS = (DIAL, STANDARDISED, EXPERTS, *RETIRED)
"""Our methods. `experts` are three policies of 0, 45 and 90 degrees, each with a third of the
steps. With continuous actions, `STANDARDISED` first takes steps at random, by which its networks'
inputs are scaled."""

EXPERT_ANGLES = (0.0, 45.0, 90.0)
LIBRARIES = ("socialiq", "mo-gymnasium", "gymnasium", "jax", "numpy")
ROUND, ACTOR_ROUND = 100, 50
"""Steps, and as many updates, before a learner of values, or an actor, acts with newer weights."""

NUMBERS = DialHyperparameters(temperature=0.01)
"""Numbers of the dials; chosen on training seeds 100 and 101."""

LAST_EXPLORATION = 0.2
"""Share of random actions in the second half of a training; it falls from 1 in the first half."""


def value_dials(
    task: Task, steps: int, seeds: Sequence[int], only: float | None = None
) -> list[Any]:
    """Train a dial for each seed, online, for all angles from 0 to 90 degrees or `only` one."""
    env = task.make()
    space: Any = env.observation_space
    static = DialConfig(
        demonstrations=False,
        backup="double",
        hidden=task.hidden,
        one_hot=one_hot(space.low, space.high) if task.exact else (),
        expert_batch=task.batch_size // 2,
        replay_batch=task.batch_size,
        updates=steps,
        replay_capacity=steps,
        environments=1,
        endings=Endings(timeout="bootstrap"),
    )
    if only is not None:
        static = dataclasses.replace(static, low=only, high=only, margin=0.0)
    base = dataclasses.replace(NUMBERS, discount=task.discount)
    numbers = [dataclasses.replace(base, seed=seed) for seed in seeds]

    def exploring(networks: Any, run: int, done: int, rng: Any) -> Driver:
        share = max(LAST_EXPLORATION, 1.0 - 2.0 * done / steps)
        explores = dataclasses.replace(numbers[run], exploration=share)
        return Driver(static, explores, networks.values, rng)

    sources = [from_env(task.make(), ROUND, goes_on=True) for _ in seeds]
    collect = Collector(sources, list(seeds), exploring)
    options: dict[str, Any] = {"chunk": ROUND, "before_chunk": collect}
    return _policies(dials.train(static, numbers, sizes=sizes(env), **options))


def one_hot(low: np.ndarray, high: np.ndarray) -> tuple[tuple[int, int], ...]:
    """Return the smallest value and the number of values of each whole number observed."""
    return tuple((int(least), int(most - least) + 1) for least, most in zip(low, high, strict=True))


def _policies(trained: Any) -> list[Any]:
    return [trained.policy(run) for run in range(len(trained.hyperparameters))]


ACTOR_NUMBERS = config.SACHyperparameters(learning_rate=1e-3, temperature=0.1, polyak=0.005)
"""Numbers of soft actor-critic, and its dial; not tuned."""


def soft_actors(
    task: Task,
    steps: int,
    runs: Sequence[tuple[int, float]],
    dial: bool = False,
    changes: Sequence[Standardisation] = (),
) -> list[Any]:
    """Train soft actor-critic, or its dial, for each run: a seed, and an angle in degrees."""
    static = config.SACConfig(
        hidden=task.hidden,
        batch_size=task.batch_size,
        updates=steps,
        replay_capacity=steps,
        updates_per_round=ACTOR_ROUND,
        dial=dial,
    )
    base = dataclasses.replace(ACTOR_NUMBERS, discount=task.discount)
    numbers = [dataclasses.replace(base, seed=seed, angle=angle) for seed, angle in runs]
    makers = [change.maker(task.make) for change in changes] or [task.make] * len(numbers)
    sources = [from_env(make(), ACTOR_ROUND, continuous=True, goes_on=True) for make in makers]
    acts = drawing(static, static.env_steps_per_update)
    collect = Collector(sources, [run.seed for run in numbers], acts)
    env = task.make()
    options: dict[str, Any] = {"chunk": ACTOR_ROUND, "before_chunk": collect}
    options["sizes"] = sizes(env)[0], action_size(env)
    return _policies(actors.train(static, numbers, **options))


@dataclasses.dataclass(frozen=True)
class Training:
    """Training of one method on a task with several seeds, in one program."""

    task: str
    method: str
    seeds: tuple[int, ...]
    steps: int


def train_and_evaluate(
    run: Training, folder: Path, _inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write one piece for each seed."""
    task = dataclasses.replace(TASKS[run.task], steps=run.steps)
    began = time.perf_counter()
    outcomes, steps, settings = trained(task, run.method, run.seeds)
    seconds = (time.perf_counter() - began) / len(outcomes)
    progress(0.8)
    (folder / FOLDER).mkdir(exist_ok=True)
    for seed, outcome in zip(run.seeds, outcomes, strict=True):
        turned = not isinstance(outcome, list)
        policies = [outcome.at(angle) for angle in ANGLES] if turned else outcome
        totals = []
        for policy in policies:
            rolled = rollout_env(task.make(), policy, task.episodes, task.first_episode)
            sums = rolled.transitions.totals()
            totals.append([round(float(total.mean()), 6) for total in sums])
        piece = Piece(
            task=run.task,
            method=run.method,
            seed=seed,
            steps=steps,
            evaluation_steps_while_training=0,
            angles=list(ANGLES) if turned else None,
            totals=totals,
            settings=settings | {"allowed_steps": run.steps},
            seconds=round(seconds, 1),
            versions=versions(LIBRARIES),
        )
        write_atomically(folder / FOLDER / piece.file, piece.content())


def trained(task: Task, method: str, seeds: Sequence[int]) -> tuple[list[Any], int, dict[str, Any]]:
    """Return for each seed a dial or a list of policies, the steps taken, and the settings."""
    size, count = ACTOR_ROUND if task.continuous else ROUND, len(EXPERT_ANGLES)
    names = ("learning_rate", "temperature", "polyak", "strength")
    numbers = dataclasses.asdict(ACTOR_NUMBERS if task.continuous else NUMBERS)
    settings = {name: value for name, value in numbers.items() if name in names}
    settings |= {"hidden": list(task.hidden), "batch_size": task.batch_size}
    settings["discount"] = task.discount
    dials_of_seeds = [(seed, 0.0) for seed in seeds]
    if method == DIAL:
        steps = task.steps // size * size  # whole rounds
        if task.continuous:
            return soft_actors(task, steps, dials_of_seeds, dial=True), steps, settings
        return value_dials(task, steps, seeds), steps, settings
    if method == STANDARDISED:
        steps = (task.steps - EXPLORED) // size * size
        if steps <= 0:
            raise UserError(f"{task.steps} steps are too few: {EXPLORED} are taken at random")
        changes = [Standardisation.of(explored(task.make(), seed)) for seed in seeds]
        policies = soft_actors(task, steps, dials_of_seeds, True, changes)
        turned = [change.policy(dial) for change, dial in zip(changes, policies, strict=True)]
        return turned, EXPLORED + steps, settings
    steps = task.steps // count // size * size  # of an expert, on R(α) alone
    if task.continuous:
        runs = [(seed, angle) for seed in seeds for angle in EXPERT_ANGLES]
        policies = soft_actors(task, steps, runs)
        by_seed = [policies[first : first + count] for first in range(0, len(policies), count)]
        return by_seed, count * steps, settings
    by_angle = [
        [dial.at(angle) for dial in value_dials(task, steps, seeds, only=angle)]
        for angle in EXPERT_ANGLES
    ]
    return [list(experts) for experts in zip(*by_angle, strict=True)], count * steps, settings
