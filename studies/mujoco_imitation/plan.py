"""Configuration of the study, the pieces that are there, and the jobs of what is missing."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from socialiq import UserError
from socialiq.demonstrations import files
from socialiq.foreign import one_line
from socialiq.learners.settings import check_counts
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.storage import read_json, shipped
from socialiq_lab.comparison import as_file_name, check_names
from socialiq_lab.jobs import Job, ProgressCallback
from studies.mujoco_imitation import runs
from studies.mujoco_imitation.runs import METHODS, POLICY, RECORD, TASKS, VARIANTS

COUNTS = (1, 5, 25)  # trajectories of a set of demonstrations, as in the tables


@dataclass(frozen=True)
class Config:
    """Configuration of the study. The defaults are the whole plan; what is done of it accumulates.

    A piece is an expert, or one run: a task, a method, a number of trajectories and a seed.
    """

    tasks: tuple[str, ...] = tuple(TASKS)  # names of `TASKS`; MuJoCo is the extra mujoco
    methods: tuple[str, ...] = tuple(METHODS)  # names of `METHODS`
    variants: tuple[str, ...] = tuple(VARIANTS)
    """Names of `VARIANTS`, ablations of online imitation: on Hopper, from five trajectories."""
    ablate: bool = True  # whether the ablations belong to the plan
    trajectories: tuple[int, ...] = COUNTS  # trajectories of a set of demonstrations
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Seeds of imitation, each with a set of demonstrations of its own; 100 to 199 were used in
    development."""
    pieces: str = ""  # folder of results whose pieces are taken over and not made again
    new: bool = True
    """Whether pieces that are missing are made; else the tables are of those that are there."""
    expert_seed: int = 10  # training seed of the experts
    expert_updates: int = 0  # updates of an expert; 0 for those of its task
    updates: int = 0  # updates of each imitation; 0 for those of its method
    every: int = 20_000  # updates between two checkpoints of an expert
    judged: int = 10  # episodes by which the best of them is chosen
    judging_seed: int = 30_000
    """Seed of the first of these; 50,000,000 and later ones were used in development."""
    expert_episodes: int = 50  # episodes of an expert's reported return
    data_seed: int = 10_000  # seed of the first demonstrated trajectory
    episodes: int = 10  # evaluation episodes of each policy
    evaluation_seed: int = 20_000  # seed of the evaluation's first states

    def __post_init__(self) -> None:
        """Refuse unknown names and empty sizes."""
        check_counts(self, ("every", "judged", "episodes", "expert_episodes"))
        for count in self.trajectories:
            if not 1 <= count <= max(COUNTS):
                raise UserError(f"trajectories must be 1 to {max(COUNTS)}, got {count}")
        check_names(self, tasks=TASKS, methods=METHODS, variants=VARIANTS)


FOLDER = "pieces"
Pieces = dict[str, bytes]
"""Content of the files of pieces by name: the record of each run, and two files of each expert."""


def name_of(task: str, method: str, trajectories: int, seed: int) -> str:
    """Return the name of a run's file."""
    return f"{task}-{as_file_name(method)}-{trajectories}-{seed}.json"


def expert_of(pieces: Pieces, task: str) -> Pieces:
    """Return the files of a task's expert by their name in its job; none without one."""
    names = {name: f"{task}_{name}" for name in (RECORD, POLICY)}
    return {name: pieces[file] for name, file in names.items() if file in pieces}


def committed(folder: str) -> Pieces:
    """Read the pieces of a results folder; none if no folder is named."""
    if not folder:
        return {}
    source = shipped(Path(folder)) / FOLDER
    if not source.is_dir():
        raise UserError(f"{folder} holds no pieces: name a results folder of this study")
    pieces: Pieces = {}
    for path in sorted(source.glob("*.json")):
        record = read_json(path)
        if path.name.endswith(f"_{RECORD}"):
            policy = path.with_name(path.name.replace(RECORD, POLICY))
            if not policy.is_file():
                raise UserError(f"{policy} is missing: restore it, or leave out {path.name}")
            pieces |= {path.name: path.read_bytes(), policy.name: policy.read_bytes()}
            continue
        try:
            key = [record[name] for name in ("task", "method", "trajectories", "seed")]
            is_known = key[0] in TASKS and key[1] in runs.RECIPES
            pieces[name_of(*key)] = path.read_bytes()
        except (KeyError, TypeError) as error:
            raise UserError(f"{path} is damaged: restore it or make it again") from error
        if not is_known:
            what = one_line(f"{key[1]} on {key[0]}")
            raise UserError(
                f"{path} is of {what}, which is unknown here: remove it, or update socialiq"
            )
    return pieces


ABLATED = ("Hopper", 5)  # task and number of trajectories of the ablations


@dataclass(frozen=True)
class Showing:
    """Trajectories of an expert, a new one or one of a results folder: a set of one seed."""

    task: str
    trajectories: int
    seed: int
    pieces: str = ""
    sha256: str = ""


def show(
    showing: Showing, folder: Path, inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write whole trajectories of the expert's mean actions."""
    if showing.pieces:
        if _sha256(committed(showing.pieces), showing.task) != showing.sha256:
            raise UserError(
                f"{showing.pieces} has changed since the study began: give the command again"
            )
        expert = shipped(Path(showing.pieces)) / FOLDER / f"{showing.task}_{POLICY}"
    else:
        expert = next(iter(inputs.values())) / POLICY
    policy = ActorPolicy.load(expert)
    episodes = runs.played(TASKS[showing.task], policy, showing.trajectories, showing.seed)
    files.save(folder / runs.SHOWN, episodes)
    progress(1.0)


def _sha256(pieces: Pieces, task: str) -> str:
    expert = expert_of(pieces, task)
    return hashlib.sha256(b"".join(expert[name] for name in sorted(expert))).hexdigest()


def cells(config: Config) -> Iterator[tuple[str, str, int]]:
    """Yield task, method and number of trajectories of each cell of the plan."""
    for task, count, method in product(config.tasks, config.trajectories, config.methods):
        if METHODS[method].forces or TASKS[task].forces:
            yield task, method, count
    task, count = ABLATED
    if config.ablate and task in config.tasks and count in config.trajectories:
        for variant in config.variants:
            yield task, variant, count


def jobs(config: Config) -> list[Job]:
    """Return `plan`, once MuJoCo is known to be there."""
    if planned := plan(config):
        runs.make_env(TASKS[config.tasks[0]]).close()
    return planned


def plan(config: Config) -> list[Job]:
    """Return the jobs of what is missing, each after its inputs."""
    there, planned = committed(config.pieces), list[Job]()
    for task in config.tasks if config.new else ():
        missing: dict[tuple[str, int], tuple[int, ...]] = {}
        for of_task, method, count in cells(config):
            seeds = tuple(s for s in config.seeds if name_of(task, method, count, s) not in there)
            if of_task == task and seeds:
                missing[method, count] = seeds
        source, inputs = (config.pieces, _sha256(there, task)), ()
        if not expert_of(there, task):
            settings = TASKS[task].expert
            recipe = runs.Expert(
                task=task,
                seed=config.expert_seed,
                settings=replace(settings, updates=config.expert_updates or settings.updates),
                every=config.every,
                judged=config.judged,
                judging_seed=config.judging_seed,
                episodes=config.expert_episodes,
                evaluation_seed=config.evaluation_seed,
            )
            planned.append(Job(f"expert/{task}", runs.train_expert, recipe, cost=300.0))
            source, inputs = (), (f"expert/{task}",)
        for seed in sorted({seed for seeds in missing.values() for seed in seeds}):
            first = config.data_seed + max(COUNTS) * seed
            showing = Showing(task, max(config.trajectories), first, *source)
            planned.append(Job(f"shown/{task}-{seed}", show, showing, inputs, cost=5.0))
        for (method, count), seeds in missing.items():
            evaluation = config.updates, config.episodes, config.evaluation_seed
            run = runs.Imitation(task, method, count, seeds, *evaluation)
            sets = tuple(f"shown/{task}-{seed}" for seed in seeds)
            cost = len(seeds) * (90.0 if runs.RECIPES[method].online else 15.0)
            name = "runs/" + name_of(task, method, count, seeds[0]).removesuffix(".json")
            planned.append(Job(name, runs.imitate, run, sets, cost=cost))
    return planned
