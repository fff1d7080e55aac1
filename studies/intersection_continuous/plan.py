"""Configuration and jobs of the study: train experts, learners and dials, and drive them all."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import UserError
from socialiq.evaluation import road_training as road
from socialiq.evaluation import rollout
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.acting import actors_together
from socialiq.learners.collect import VectorCollector
from socialiq.learners.continuous import config as actors
from socialiq.learners.continuous.train import train
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import train as dial_training
from socialiq.learners.settings import check_counts
from socialiq.worlds.gym import learning_env
from socialiq.worlds.intersection.options import ContinuousOptions, Options
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.intersection import demonstration_sets as sets
from socialiq_lab.intersection.driving import Driving, evaluation
from socialiq_lab.intersection.training import fit
from socialiq_lab.jobs import Job, ProgressCallback

EXPERTS, LEARNERS, BASELINE = "experts/sac", "learners/targets", "learners/baseline"
LONGER = "learners/longer"
CLONES, WEIGHTED, TD3_BC = "offline/cloning", "offline/weighted-cloning", "offline/td3-bc"
POLICIES = {
    EXPERTS: ("expert", True),
    LEARNERS: ("", True),
    BASELINE: ("baseline", False),
    LONGER: ("longer IQ-Learn", True),
    CLONES: ("cloning", False),
    WEIGHTED: ("weighted cloning", True),
    TD3_BC: ("TD3+BC", True),
}
"""Jobs of experts and of what learns from a mixture: the beginning of a policy's name in the
tables, and whether there is a run for every angle."""
KINDS = CONTINUOUS, HIGH_ANGLES, DISCRETE = (
    "dials/continuous",
    "dials/high-angles",
    "dials/discrete",
)
"""Jobs that train dials."""

_HIGH_ANGLES = dataclasses.replace(actors.DIAL, high_share=0.8)
"""Dials with most angles beyond 65 degrees; chosen among ten settings in development."""

_DISCRETE = dataclasses.replace(
    dial.INTERSECTION.structure,
    hidden=(128, 128),
    replay_batch=128,
    updates=actors.EXPERT.updates,
    replay_capacity=actors.EXPERT.replay_capacity,
)
"""The preset of discrete actions in the continuous dial's budget: its updates, rows, environment
steps and widths; like it, it is trained without demonstrations (`jobs`)."""

_NETWORK = {name: getattr(actors.LEARNER, name) for name in ("view", "hidden", "batch_size")}
_CLONE = bc.CloningConfig(**_NETWORK, updates=actors.EXPERT.updates)
_CLONE_NUMBERS = bc.CloningHyperparameters(learning_rate=1e-3)  # chosen in development
_TD3_BC = actors.TD3BCConfig(
    **_NETWORK, updates=actors.EXPERT.updates, endings=actors.LEARNER.endings
)
_TD3_BC_NUMBERS = actors.TD3BCHyperparameters()


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results.

    Training seeds 100 to 199 and episodes from 50,000,000 on were used in development. Structures
    are static configurations, numbers hyperparameters without angle, seed and data.
    """

    seeds: tuple[int, ...] = (70, 71, 72)  # of dials with either kind of actions
    learner_seeds: tuple[int, ...] = (75, 76)  # each with a mixture of its own
    expert_seed: int = 78  # of the three experts
    angles: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 15.0).tolist())
    """Angles at which dials are driven, in degrees."""
    expert: actors.SACConfig = actors.EXPERT
    numbers: actors.SACHyperparameters = actors.EXPERT_NUMBERS  # of continuous dials, too
    continuous: actors.SACConfig = actors.DIAL
    high_angles: actors.SACConfig = _HIGH_ANGLES
    discrete: dial.DialConfig = _DISCRETE
    discrete_numbers: dial.DialHyperparameters = dial.INTERSECTION.numbers
    learner: actors.ActorIQLearnConfig = actors.LEARNER  # the baseline has no prior
    learner_numbers: actors.ActorIQLearnHyperparameters = actors.LEARNER_NUMBERS
    longer: actors.ActorIQLearnConfig = actors.LONGER  # as many updates as clones
    longer_numbers: actors.ActorIQLearnHyperparameters = actors.LONGER_NUMBERS
    clone: bc.CloningConfig = _CLONE  # of all demonstrations alike, and weighted (Eq B.2)
    clone_numbers: bc.CloningHyperparameters = _CLONE_NUMBERS
    td3_bc: actors.TD3BCConfig = _TD3_BC  # on R(α)
    td3_bc_numbers: actors.TD3BCHyperparameters = _TD3_BC_NUMBERS  # the paper's
    options: ContinuousOptions = field(default_factory=ContinuousOptions)
    discrete_options: Options = field(default_factory=lambda: Options(destination="straight"))
    """The same scenario with discrete actions."""
    pool_episodes: int = 1_000  # recorded of each expert
    mixture: str = sets.MIXTURE  # of the experts' demonstrations, as in the intersection study
    size: int = 5_000  # transitions of each expert in a mixture
    environments: int = 24  # episodes side by side in training, of each run
    episodes: int = 1_000  # evaluation episodes of each policy, common to all
    first_episode: int = 21_000_000  # seed of the first one

    def __post_init__(self) -> None:
        """Refuse empty sizes."""
        if not self.seeds or not self.learner_seeds or not self.angles:
            raise UserError("name at least one training seed, of dials and of learners, and angle")
        check_counts(self, ("pool_episodes", "size", "environments", "episodes"))


@dataclass(frozen=True)
class Runs:
    """Runs of one program; discrete actions for dials of `DialConfig`, else continuous ones."""

    structure: Any
    numbers: tuple[Any, ...]
    options: Options
    environments: int
    mixture: str
    size: int  # transitions of each expert in a mixture, for what learns from demonstrations


def run_file(angle: float, seed: int) -> str:
    """Return the file of a run's policy, by its angle, 0 for those without, and its seed."""
    return f"{angle:g}_{seed}.safetensors"


def jobs(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    weighted = dataclasses.replace(config.clone, weighted=True)
    baseline = dataclasses.replace(config.learner, prior="none", chi2_on="expert")
    alone = dataclasses.replace(config.discrete, demonstrations=False)
    programs = {
        EXPERTS: (config.expert, config.numbers),
        LEARNERS: (config.learner, config.learner_numbers),
        BASELINE: (baseline, config.learner_numbers),
        LONGER: (config.longer, config.longer_numbers),
        CLONES: (config.clone, config.clone_numbers),
        WEIGHTED: (weighted, config.clone_numbers),
        TD3_BC: (config.td3_bc, config.td3_bc_numbers),
        CONTINUOUS: (dataclasses.replace(config.continuous, dial=True), config.numbers),
        HIGH_ANGLES: (dataclasses.replace(config.high_angles, dial=True), config.numbers),
        DISCRETE: (alone, config.discrete_numbers),
    }
    recording = sets.Recording(episodes=config.pool_episodes, options=config.options)
    planned: list[Job] = []
    for name, (structure, base) in programs.items():
        options = config.discrete_options if name == DISCRETE else config.options
        if name in KINDS:
            numbers = [dataclasses.replace(base, seed=seed) for seed in config.seeds]
        else:
            seeds = (config.expert_seed,) if name == EXPERTS else config.learner_seeds
            numbers = [
                dataclasses.replace(base, angle=angle, seed=seed)
                for angle in (rollout.MODES.values() if POLICIES[name][1] else (0.0,))
                for seed in seeds
            ]
        runs = Runs(
            structure, tuple(numbers), options, config.environments, config.mixture, config.size
        )
        own = name == EXPERTS or name in KINDS
        cost = 100.0 if own else 10.0
        inputs = () if own else (sets.DEMONSTRATIONS,)
        planned.append(Job(name, train_runs, runs, inputs, cost * len(numbers)))
        if name == EXPERTS:
            planned.append(
                Job(sets.DEMONSTRATIONS, sets.record_experts, recording, (EXPERTS,), cost=10.0)
            )
        driving = Driving(
            angles=config.angles if name in KINDS else (),
            episodes=config.episodes,
            first_seed=config.first_episode,
            options=options,
        )
        planned.append(evaluation(name, driving, cost=20.0))
    return planned


def train_runs(
    config: Runs, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the policy of each run; each training seed of learners has a mixture of its own."""
    structure, seeds = config.structure, list(dict.fromkeys(run.seed for run in config.numbers))
    data = [
        sets.mixture_of(recordings, config.mixture, config.size, seed)
        for recordings in inputs.values()
        for seed in seeds
    ]
    numbers = [
        dataclasses.replace(run, dataset=seeds.index(run.seed)) if data else run
        for run in config.numbers
    ]
    world = Intersection(config.options)
    if isinstance(structure, dial.DialConfig):
        count, steps = config.environments, actors.STEPS_PER_UPDATE
        collect = road.dial_collector(structure, numbers, world, count, steps)
        learn = partial(dial_training.train, sizes=road.sizes_of(config.options, True))
        program = partial(learn, structure, numbers, data, before_chunk=collect)
    elif isinstance(structure, bc.CloningConfig):
        program = partial(bc.GaussianCloning.train_on, structure, numbers, data)
    elif isinstance(structure, actors.TD3BCConfig):
        program = partial(train, structure, numbers, data)
    else:
        clock = structure.times > 0
        env = learning_env(world, len(numbers) * config.environments, clock)
        rounds = -(-road.CHUNK * structure.env_steps_per_update // config.environments)
        collect = VectorCollector(env, rounds, numbers, actors_together(structure, numbers))
        sizes = world.n_features + clock, config.options.width
        program = partial(train, structure, numbers, data, sizes=sizes, before_chunk=collect)
    files = [run_file(getattr(run, "angle", 0.0), run.seed) for run in numbers]
    fit(program, folder, on_progress, files)
