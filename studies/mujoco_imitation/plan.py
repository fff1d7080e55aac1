"""Jobs of the study: what is missing of the plan."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from socialiq.errors import UserError
from socialiq.storage import write_atomically
from socialiq_lab.jobs import Job, ProgressCallback
from studies.mujoco_imitation.config import COUNTS, Config
from studies.mujoco_imitation.expert import Expert, train_expert
from studies.mujoco_imitation.methods import METHODS, method_of
from studies.mujoco_imitation.pieces import Pieces, committed, name_of
from studies.mujoco_imitation.runs import Imitation, Showing, imitate, show
from studies.mujoco_imitation.tasks import TASKS, make_env

ABLATED = ("Hopper", 5)
"""Task and number of trajectories of the ablations."""


@dataclass(frozen=True)
class Kept:
    """An expert that is there already.

    Attributes:
        task: Name in `TASKS`.
        folder: Results folder with its pieces.
        sha256: Of its files, one after the other.
    """

    task: str
    folder: str
    sha256: str


def keep(one: Kept, folder: Path, inputs: Mapping[str, Path], progress: ProgressCallback) -> None:
    """Copy an expert's files.

    Raises:
        UserError: If they have changed since the plan was made.
    """
    del inputs
    files = committed(one.folder).experts.get(one.task, {})
    if _sha256(files) != one.sha256:
        raise UserError(f"{one.folder} has changed since the study began: give the command again")
    for name, content in files.items():
        write_atomically(folder / name, content)
    progress(1.0)


def _sha256(files: Mapping[str, bytes]) -> str:
    return hashlib.sha256(b"".join(files[name] for name in sorted(files))).hexdigest()


def cells(config: Config) -> Iterator[tuple[str, str, int]]:
    """Yield task, method and number of trajectories of each cell of the plan."""
    for task in config.tasks:
        for count in config.trajectories:
            for method in config.methods:
                if METHODS[method].forces or TASKS[task].forces:
                    yield task, method, count
    task, count = ABLATED
    if config.ablate and task in config.tasks and count in config.trajectories:
        for variant in config.variants:
            yield task, variant, count


def plan(config: Config) -> list[Job]:
    """Return the jobs of what is missing, each after its inputs."""
    there = committed(config.pieces)
    if not config.new:
        return []
    return [job for task in config.tasks for job in _of_task(config, task, there)]


def checked_plan(config: Config) -> list[Job]:
    """Return `plan`, once MuJoCo is known to be there.

    Raises:
        UserError: If it isn't.
    """
    jobs = plan(config)
    if jobs:
        make_env(TASKS[config.tasks[0]]).close()
    return jobs


def _of_task(config: Config, task: str, there: Pieces) -> Iterator[Job]:
    missing = {
        (method, count): seeds
        for of, method, count in cells(config)
        if of == task and (seeds := _missing(config, there, task, method, count))
    }
    if task in there.experts and not missing:
        return
    yield _expert(config, task, there)
    for seed in sorted({seed for seeds in missing.values() for seed in seeds}):
        first = config.data_seed + max(COUNTS) * seed
        one = Showing(task, max(config.trajectories), first)
        yield Job(f"shown/{task}-{seed}", show, one, (f"expert/{task}",), cost=5.0)
    for (method, count), seeds in missing.items():
        run = Imitation(
            task, method, count, seeds, config.updates, config.episodes, config.evaluation_seed
        )
        shown = tuple(f"shown/{task}-{seed}" for seed in seeds)
        cost = len(seeds) * (90.0 if method_of(method).online else 15.0)
        name = name_of((task, method, count, seeds[0])).removesuffix(".json")
        yield Job(f"runs/{name}", imitate, run, shown, cost=cost)


def _missing(config: Config, there: Pieces, task: str, method: str, count: int) -> tuple[int, ...]:
    return tuple(s for s in config.seeds if (task, method, count, s) not in there.runs)


def _expert(config: Config, task: str, there: Pieces) -> Job:
    name = f"expert/{task}"
    if task in there.experts:
        kept = Kept(task, config.pieces, _sha256(there.experts[task]))
        return Job(name, keep, kept, cost=1.0)
    settings = TASKS[task].expert
    recipe = Expert(
        task=task,
        seed=config.expert_seed,
        settings=replace(settings, updates=config.expert_updates or settings.updates),
        every=config.every,
        judged=config.judged,
        judging_seed=config.judging_seed,
        episodes=config.expert_episodes,
        evaluation_seed=config.evaluation_seed,
    )
    return Job(name, train_expert, recipe, cost=300.0)
