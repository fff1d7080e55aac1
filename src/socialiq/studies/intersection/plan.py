"""The jobs of the intersection study, and how their folders are called."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    Recording,
    record_demonstrations,
)
from socialiq.experiments.intersection.experts import (
    evaluations,
    expert_name,
    finer,
    flat_expert,
    on_highway,
    policy_file,
)
from socialiq.experiments.intersection.jobs import (
    Evaluation,
    ExpertRun,
    LearnerRun,
    evaluate,
    train_expert,
    train_learner,
)
from socialiq.experiments.jobs import Job
from socialiq.learners.dqn import config as dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets
from socialiq.nn.view import CHOICES
from socialiq.social.returns import TARGET_KINDS
from socialiq.studies.intersection.config import Config
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import NAMES

TARGETS = ("baseline", *MODES)
PRESETS = {
    "thesis": (presets.INTERSECTION_THESIS, presets.INTERSECTION_THESIS_NUMBERS),
    "calibrated": (presets.INTERSECTION_CALIBRATED, presets.INTERSECTION_CALIBRATED_NUMBERS),
}
TRAINED = (("thesis", "online"), ("calibrated", "online"), ("calibrated", "offline"))
SHIPPED = ("calibrated", "online")
"""Group whose learners are drawn beside the thesis' and included in the atlas."""
STRENGTHS = (0.3, 1.0, 2.0, 3.0, 5.0, 10.0)
TEMPERATURES = (1.0, 0.3, 0.1, 0.03)
ENDINGS = ("zero", "absorbing")
SIZES = {"equal_transitions": (1000, 3000, 15_000), "equal_trajectories": (100, 1000)}


def plan(config: Config) -> list[Job]:
    """Every job of the chosen parts, each after its inputs."""
    parts = {
        "timeouts": _timeouts,
        "views": _views,
        "strengths": _strengths,
        "targets": _targets,
        "data": _data,
    }
    jobs = list(_main(config))
    for part, make in parts.items():
        if part in config.parts:
            jobs += make(config)
    taken = members(config)
    return [
        *jobs,
        *evaluations(jobs, config.episodes),
        *_drivers(config),
        *_connected(config),
        *on_highway(taken, config.highway_episodes),
    ]


def learner_name(preset: str, setting: str, target: str, seed: int) -> str:
    """Folder of a learner of the main part."""
    return f"learners/{preset}/{setting}/{target}/{seed}"


def _main(config: Config) -> Iterator[Job]:
    first = config.expert_seed
    yield from (flat_expert(mode, first, config.expert_steps) for mode in MODES)
    pools = tuple(expert_name("flat", mode, first) for mode in MODES)
    recording = Recording(episodes=config.pool_episodes)
    yield Job(DEMONSTRATIONS, record_demonstrations, recording, pools, cost=20.0)
    for (preset, setting), target in itertools.product(TRAINED, TARGETS):
        structure, numbers = PRESETS[preset]
        structure = dataclasses.replace(structure, updates=config.updates)
        if setting == "offline":
            structure = presets.offline(structure)
        for seed in config.seeds:
            run = _learner(config, structure, numbers, target, seed)
            name = learner_name(preset, setting, target, seed)
            yield Job(
                name, train_learner, run, (DEMONSTRATIONS,), cost=80.0 if structure.online else 45.0
            )


def _timeouts(config: Config) -> Iterator[Job]:
    """The experts of main whose reward a long wait can feed, but for the one thing."""
    for mode, angle in list(MODES.items())[1:]:
        structure = dqn.StaticConfig(steps=config.expert_steps // 2, through_timeouts=True)
        run = ExpertRun(structure, dqn.Hyperparameters(angle=angle, seed=config.expert_seed))
        name = f"timeouts/through/{mode}/{config.expert_seed}"
        yield Job(name, train_expert, run, cost=450.0)


def _views(config: Config) -> Iterator[Job]:
    for view, seed in itertools.product(CHOICES, config.ablation_seeds):
        structure = dqn.StaticConfig(view, steps=config.view_steps, steps_per_update=32)
        run = ExpertRun(structure, finer(dqn.Hyperparameters(seed=seed)))
        yield Job(f"views/{view}/{seed}", train_expert, run, cost=120.0)


def _strengths(config: Config) -> Iterator[Job]:
    structure, numbers = _ablated(config.updates)
    for strength, target in itertools.product(STRENGTHS, MODES):
        changed = dataclasses.replace(numbers, strength=strength)
        for seed in config.ablation_seeds:
            run = _learner(config, structure, changed, target, seed)
            name = f"strengths/{strength:g}/{target}/{seed}"
            yield Job(name, train_learner, run, (DEMONSTRATIONS,), cost=75.0)


def _targets(config: Config) -> Iterator[Job]:
    structure, numbers = _ablated(config.ablation_updates)
    cells = itertools.product(TARGET_KINDS, TEMPERATURES, ENDINGS, TARGETS)
    for kind, temperature, ending, target in cells:
        if target == "baseline" and kind != next(iter(TARGET_KINDS)):
            continue  # without a prior the kind of target means nothing
        endings = iq.Endings(arrival=ending, collision=ending, timeout=ending)
        changed = dataclasses.replace(structure, target_kind=kind, endings=endings)
        seed = config.ablation_seeds[0]
        cooled = dataclasses.replace(numbers, temperature=temperature)
        run = _learner(config, changed, cooled, target, seed)
        name = f"targets/{kind}/{temperature:g}/{ending}/{target}/{seed}"
        yield Job(name, train_learner, run, (DEMONSTRATIONS,), cost=40.0)


def _data(config: Config) -> Iterator[Job]:
    structure, numbers = _ablated(config.ablation_updates)
    cells = [(mixture, size) for mixture, sizes in SIZES.items() for size in sizes]
    for (mixture, size), target in itertools.product(cells, TARGETS):
        for seed in config.ablation_seeds:
            run = _learner(config, structure, numbers, target, seed)
            run = dataclasses.replace(run, mixture=mixture, size=size)
            name = f"data/{mixture}/{size}/{target}/{seed}"
            yield Job(name, train_learner, run, (DEMONSTRATIONS,), cost=40.0)


def _drivers(config: Config) -> Iterator[Job]:
    for name in NAMES:
        run = Evaluation(driver=name, readouts=("greedy",), episodes=config.episodes)
        yield Job(f"evaluation/drivers/{name}", evaluate, run, cost=3.0)


def _connected(config: Config) -> Iterator[Job]:
    """The atlas' policies among drivers who look ahead across lanes that are connected."""
    for name, job in members(config).items():
        options = Options(connected_lanes=True)
        run = Evaluation(policy_file(job), ("greedy",), config.episodes, options=options)
        yield Job(f"connected/{name}", evaluate, run, (job,), cost=3.0)


def members(config: Config) -> dict[str, str]:
    """Folder of the job of each policy of the atlas, by its name there.

    Experts, and the first training seed's baseline and trio.
    """
    first = config.expert_seed
    found = {f"expert_{mode}": expert_name("flat", mode, first) for mode in MODES}
    return found | {target: learner_name(*SHIPPED, target, config.seeds[0]) for target in TARGETS}


def _ablated(updates: int) -> tuple[iq.StaticConfig, iq.Hyperparameters]:
    """The calibrated preset: what the ablations vary."""
    structure, numbers = PRESETS["calibrated"]
    return dataclasses.replace(structure, updates=updates), numbers


def _learner(
    config: Config, structure: iq.StaticConfig, numbers: iq.Hyperparameters, target: str, seed: int
) -> LearnerRun:
    if target == "baseline":
        structure, angle = presets.baseline(structure), 0.0
    else:
        angle = MODES[target]
    numbers = dataclasses.replace(numbers, angle=angle, seed=seed)
    return LearnerRun(structure, numbers, config.mixture, config.size)
