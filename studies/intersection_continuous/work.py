"""Jobs of the study: train experts, record them, train learners and dials, drive all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.road_training import CHUNK, dial_collector, sizes_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.acting import actors_together
from socialiq.learners.behaviour_cloning import GaussianCloning
from socialiq.learners.collect import VectorCollector
from socialiq.learners.continuous.config import STEPS_PER_UPDATE
from socialiq.learners.continuous.train import train
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import train as dial_training
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.dial_policy import DialPolicy
from socialiq.worlds.gym import learning_env
from socialiq.worlds.intersection.options import ContinuousOptions, Options
from socialiq.worlds.intersection.world import Batch, Intersection
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    Recording,
    mixture_of,
    record_experts,
)
from socialiq_lab.intersection.driving import BATCH, EpisodesRun, save_episodes
from socialiq_lab.intersection.training import fit
from socialiq_lab.jobs import Job, ProgressCallback
from studies.intersection_continuous.config import Config

EXPERTS, LEARNERS, BASELINE = "experts/sac", "learners/targets", "learners/baseline"
LONGER = "learners/longer"
CLONES, WEIGHTED, TD3_BC = "offline/cloning", "offline/weighted-cloning", "offline/td3-bc"
OF_MIXTURE = {
    LEARNERS: True,
    BASELINE: False,
    LONGER: True,
    CLONES: False,
    WEIGHTED: True,
    TD3_BC: True,
}
"""Jobs that learn from a mixture, and whether each has a run for every angle."""
CONTINUOUS, HIGH_ANGLES = "dials/continuous", "dials/high-angles"
DISCRETE = "dials/discrete"
KINDS = (CONTINUOUS, HIGH_ANGLES, DISCRETE)
"""Jobs that train dials."""
EVALUATION = "evaluation"


@dataclass(frozen=True)
class Training:
    """Runs of one program with continuous actions."""

    structure: Any
    numbers: tuple[Any, ...]
    options: ContinuousOptions
    environments: int
    mixture: str = ""
    """Mixture of demonstrations; none for soft actor-critic."""
    size: int = 0
    """Transitions of each expert in a mixture."""


@dataclass(frozen=True)
class DiscreteTraining:
    """Runs of discrete dials in one program."""

    structure: dial.DialConfig
    numbers: tuple[dial.DialHyperparameters, ...]
    options: Options
    environments: int


@dataclass(frozen=True, kw_only=True)
class Driving(EpisodesRun):
    """Greedy episodes of all policies of a job, of dials at some angles."""

    angles: tuple[float, ...] = ()
    options: Options = field(default_factory=ContinuousOptions)


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    experts = [
        dataclasses.replace(config.numbers, angle=angle, seed=config.expert_seed)
        for angle in MODES.values()
    ]
    seeded = [dataclasses.replace(config.numbers, seed=seed) for seed in config.seeds]
    training = partial(Training, options=config.options, environments=config.environments)
    told = DiscreteTraining(
        dataclasses.replace(config.discrete, demonstrations=False),
        tuple(dataclasses.replace(config.discrete_numbers, seed=seed) for seed in config.seeds),
        config.discrete_options,
        config.environments,
    )
    soft_dials = {CONTINUOUS: config.continuous, HIGH_ANGLES: config.high_angles}
    recording = Recording(episodes=config.pool_episodes, options=config.options)
    return [
        Job(EXPERTS, train_soft, training(config.expert, tuple(experts)), cost=200.0),
        Job(DEMONSTRATIONS, record_trained, recording, (EXPERTS,), cost=10.0),
        *_learners(config, training),
        *(
            Job(
                name,
                train_soft,
                training(dataclasses.replace(run, dial=True), tuple(seeded)),
                cost=300.0,
            )
            for name, run in soft_dials.items()
        ),
        Job(DISCRETE, train_discrete, told, cost=200.0),
        *_evaluations(config),
    ]


def _learners(config: Config, training: Any) -> list[Job]:
    """Learners of each target, the baseline, which has no prior, and others beside them."""
    demonstrated = partial(training, mixture=config.mixture, size=config.size)
    baseline = dataclasses.replace(config.learner, prior="none", chi2_on="expert")
    weighted = dataclasses.replace(config.clone, weighted=True)
    structures = {
        LEARNERS: (config.learner, config.learner_numbers, train_learners),
        BASELINE: (baseline, config.learner_numbers, train_learners),
        LONGER: (config.longer, config.longer_numbers, train_learners),
        CLONES: (config.clone, config.clone_numbers, train_offline),
        WEIGHTED: (weighted, config.clone_numbers, train_offline),
        TD3_BC: (config.td3_bc, config.td3_bc_numbers, train_offline),
    }
    jobs = []
    for name, (structure, base, work) in structures.items():
        numbers = tuple(
            dataclasses.replace(base, angle=angle, seed=seed, dataset=number)
            for angle in angles_of(name)
            for number, seed in enumerate(config.learner_seeds)
        )
        run = demonstrated(structure, numbers)
        jobs.append(Job(name, work, run, (DEMONSTRATIONS,), cost=10.0 * len(numbers)))
    return jobs


def angles_of(name: str) -> tuple[float, ...]:
    """Return the angles of a job of `OF_MIXTURE`; that of a run without one is 0."""
    return tuple(MODES.values()) if OF_MIXTURE[name] else (0.0,)


def _evaluations(config: Config) -> list[Job]:
    """Drive the policies of each training job."""
    driving = partial(Driving, episodes=config.episodes, first_seed=config.first_episode)
    cost = 3.0 * len(config.seeds) * len(config.angles)
    jobs = [
        Job(f"{EVALUATION}/{name}", drive, driving(options=config.options), (name,), cost=20.0)
        for name in (EXPERTS, *OF_MIXTURE)
    ]
    for name in KINDS:
        options = config.discrete_options if name == DISCRETE else config.options
        run = driving(options=options, angles=config.angles)
        jobs.append(Job(f"{EVALUATION}/{name}", drive_dials, run, (name,), cost))
    return jobs


def run_file(numbers: Any) -> str:
    """Return the file of a run's policy, by its angle if it has one, and its seed."""
    angle = getattr(numbers, "angle", 0.0)
    return f"{angle:g}_{numbers.seed}.safetensors"


def _fit_actors(
    config: Training,
    folder: Path,
    on_progress: ProgressCallback,
    datasets: Sequence[Any] = (),
) -> None:
    """Train all runs on the core, acting together, and write their policies."""
    structure, numbers = config.structure, config.numbers
    count = len(numbers) * config.environments
    env = learning_env(Intersection(config.options), count, structure.times > 0)
    rounds = -(-CHUNK * structure.env_steps_per_update // config.environments)
    sizes = (Intersection(config.options).n_features + (structure.times > 0), config.options.width)
    collector = VectorCollector(env, rounds, numbers, actors_together(structure, numbers))
    options = {"sizes": sizes, "before_chunk": collector}
    program = partial(train, structure, numbers, datasets, **options)
    fit(program, folder, on_progress, [run_file(run) for run in numbers])


def train_soft(
    config: Training, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write experts, or dials, of soft actor-critic."""
    _fit_actors(config, folder, on_progress)


def train_learners(
    config: Training, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write learners of a mixture; each training seed has a mixture of its own."""
    _fit_actors(config, folder, on_progress, _mixtures(config, inputs))


def _mixtures(config: Training, inputs: Mapping[str, Path]) -> list[Demonstrations]:
    (recordings,) = inputs.values()
    seeds = {run.dataset: run.seed for run in config.numbers}
    return [mixture_of(recordings, config.mixture, config.size, seeds[n]) for n in sorted(seeds)]


def train_offline(
    config: Training, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write clones, or TD3+BC, of a mixture, as `train_learners`, without steps of their own."""
    inputs_of_program = (config.structure, config.numbers, _mixtures(config, inputs))
    clones = isinstance(config.structure, bc.CloningConfig)
    program = partial(GaussianCloning.train_on if clones else train, *inputs_of_program)
    fit(program, folder, on_progress, [run_file(run) for run in config.numbers])


def record_trained(
    config: Recording, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Record the three experts."""
    (trained,) = inputs.values()
    experts = {
        mode: ActorPolicy.load(next(trained.glob(f"{angle:g}_*.safetensors")))
        for mode, angle in MODES.items()
    }
    record_experts(experts, config, folder, on_progress)


def train_discrete(
    config: DiscreteTraining,
    folder: Path,
    _inputs: Mapping[str, Path],
    on_progress: ProgressCallback,
) -> None:
    """Write dials of discrete actions."""
    inputs_of_program = (config.structure, config.numbers)
    world = Intersection(config.options)
    collector = dial_collector(*inputs_of_program, world, config.environments, STEPS_PER_UPDATE)
    options = {"sizes": sizes_of(config.options, True), "before_chunk": collector}
    program = partial(dial_training.train, *inputs_of_program, [], **options)
    fit(program, folder, on_progress, [run_file(run) for run in config.numbers])


def drive(
    config: Driving, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode, one file for each policy."""
    (trained,) = inputs.values()
    files = sorted(trained.glob("*.safetensors"))
    for number, file in enumerate(files, start=1):
        played = episodes_of(Batch(config.options, BATCH), ActorPolicy.load(file), config.seeds)
        save_episodes(folder / file.name, played)
        on_progress(number / len(files))


def drive_dials(
    config: Driving, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode, one file for each dial and angle."""
    (trained,) = inputs.values()
    files = sorted(trained.glob("*.safetensors"))
    for number, file in enumerate(files, start=1):
        dial = (ActorDial if config.options.continuous else DialPolicy).load(file)
        for angle in config.angles:
            played = episodes_of(Batch(config.options, BATCH), dial.at(angle), config.seeds)
            save_episodes(folder / dial_file(file.stem, angle), played)
        on_progress(number / len(files))


def dial_file(run: str, angle: float) -> str:
    """Return the file of a dial's episodes at an angle, given the stem of the dial's file."""
    return f"{run}_at_{angle:g}.safetensors"
