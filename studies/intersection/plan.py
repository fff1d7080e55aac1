"""Configuration of the intersection study, its jobs, and the names of their folders."""

import dataclasses
import itertools
from collections.abc import Iterator
from typing import Any

from socialiq import UserError
from socialiq.demonstrations.mixture import MIXTURES
from socialiq.errors import one_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners import dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import config as presets
from socialiq.nn.view import CHOICES
from socialiq.social.returns import TARGET_KINDS
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import NAMES
from socialiq_lab.intersection import driving
from socialiq_lab.intersection.driving import BEST, LAST, Driving, evaluation
from socialiq_lab.intersection.training import ExpertRun, LearnerRun, train_expert, train_learner
from socialiq_lab.jobs import Job

PARTS = ("main", "strengths", "targets", "data", "timeouts", "views")
"""Parts of the study, which STUDY.toml describes."""

TARGETS = ("baseline", *MODES)
PRESETS = {
    "thesis": (presets.INTERSECTION_THESIS, presets.INTERSECTION_THESIS_NUMBERS),
    "calibrated": (presets.INTERSECTION_CALIBRATED, presets.INTERSECTION_CALIBRATED_NUMBERS),
}
TRAINED = (("thesis", "online"), ("calibrated", "online"), ("calibrated", "offline"))
SHIPPED = ("calibrated", "online")
"""Group whose learners are drawn beside the thesis' and included in the atlas."""
VIEWS = tuple(name for name, choice in CHOICES.items() if choice is None or not choice.ahead)
"""Views that are compared; `set_ahead` came later."""

STRENGTHS = (0.3, 1.0, 2.0, 3.0, 5.0, 10.0)
TEMPERATURES = (1.0, 0.3, 0.1, 0.03)
ENDINGS = ("zero", "absorbing")
SIZES = {"equal_transitions": (1000, 3000, 15_000), "equal_trajectories": (100, 1000)}


def jobs(config: Any) -> list[Job]:
    """Return every job of the chosen parts, each after its inputs."""
    for name in config.parts:
        one_of("part", name, PARTS)
    one_of("mixture", config.mixture, tuple(MIXTURES))
    for name, value in vars(config).items():
        least = 0 if name in ("highway_episodes", "expert_seed") else 1
        if isinstance(value, int) and value < least:
            raise UserError(f"{name} must be at least {least}, got {value}")
        if isinstance(value, tuple) and not value:
            raise UserError(f"{name} must name at least one")
    trainings = list(_main(config))
    trainings += _ablations(config)
    planned = list(trainings)
    episodes = config.episodes
    for job in trainings:
        if job.work is train_expert:
            planned.append(evaluation(job.name, Driving(driver=BEST, episodes=episodes), 3.0))
        if job.stage == "experts":
            angles = (job.config.numbers.angle,)
            run = Driving(driver=BEST, angles=angles, ahead="lookahead", episodes=episodes)
            name = f"evaluation/{job.name.replace('experts/', 'foresight/')}"
            planned.append(Job(name, driving.drive, run, (job.name,), cost=20.0))
        if job.work is train_learner:
            readouts = ("greedy", "soft")
            run = Driving(driver=LAST, readouts=readouts, episodes=episodes)
            planned.append(evaluation(job.name, run, 6.0))
    for name in NAMES:
        run = Driving(driver=name, episodes=episodes)
        planned.append(Job(f"evaluation/drivers/{name}", driving.drive, run, cost=3.0))
    for name, job in members(config).items():
        driver = policy_file(job)
        options = Options(connected_lanes=True)  # of the traffic
        run = Driving(driver=driver, episodes=episodes, options=options)
        planned.append(Job(f"connected/{name}", driving.drive, run, (job,), cost=3.0))
        if config.highway_episodes:
            first = driving.FIRST_HIGHWAY_EPISODE
            run = Driving(driver=driver, episodes=config.highway_episodes, first_seed=first)
            planned.append(Job(f"highway/{name}", driving.drive_highway, run, (job,), cost=100.0))
    return planned


def policy_file(job: str) -> str:
    """Return the file of a job's network that counts: an expert's best, a learner's last."""
    return LAST if job.startswith("learners/") else BEST


def learner_name(preset: str, setting: str, target: str, seed: int) -> str:
    """Return the folder of a learner of the main part.

    Args:
        preset: Name of the preset, from `PRESETS`.
        setting: "online" or "offline".
        target: Target of the learner, from `TARGETS`.
        seed: Training seed.
    """
    return f"learners/{preset}/{setting}/{target}/{seed}"


def columns(config: Any) -> dict[tuple[str, str], dict[str, list[str]]]:
    """Return the policies behind each column of Table 6.2, for experts and groups of learners."""
    experts = {f"expert {mode}": [f"experts/flat/{mode}/{config.expert_seed}"] for mode in MODES}
    return {("experts", "flat"): experts} | {
        group: {
            target: [learner_name(*group, target, seed) for seed in config.seeds]
            for target in TARGETS
        }
        for group in TRAINED
    }


def _main(config: Any) -> Iterator[Job]:
    experts = columns(config)["experts", "flat"]
    for (name,), angle in zip(experts.values(), MODES.values(), strict=True):
        numbers = dqn.DQNHyperparameters(angle=angle, seed=config.expert_seed)
        yield _expert(name, dqn.DQNConfig(steps=config.expert_steps), numbers, cost=900.0)
    recording = driving.Recording(driver=BEST, episodes=config.pool_episodes)
    inputs = tuple(name for (name,) in experts.values())
    yield Job(driving.DEMONSTRATIONS, driving.record_experts, recording, inputs, cost=20.0)
    for (preset, setting), target in itertools.product(TRAINED, TARGETS):
        structure, numbers = PRESETS[preset]
        structure = dataclasses.replace(structure, updates=config.updates)
        if setting == "offline":
            structure = presets.offline(structure)
        for seed in config.seeds:
            name = learner_name(preset, setting, target, seed)
            cost = 80.0 if structure.online else 45.0
            yield _learner(config, name, structure, numbers, target, seed, cost)


def _ablations(config: Any) -> Iterator[Job]:
    """Vary the experts, and one setting or the data of the calibrated preset."""
    preset, numbers = PRESETS["calibrated"]
    structure = dataclasses.replace(preset, updates=config.ablation_updates)
    seeds = config.ablation_seeds
    if "timeouts" in config.parts:  # the experts that can gain by waiting
        for mode, angle in list(MODES.items())[1:]:
            static = dqn.DQNConfig(steps=config.expert_steps // 2, through_timeouts=True)
            run = dqn.DQNHyperparameters(angle=angle, seed=config.expert_seed)
            yield _expert(f"timeouts/through/{mode}/{config.expert_seed}", static, run, cost=450.0)
    if "views" in config.parts:  # egoists, whose exploration and step size fall further
        run = dqn.DQNHyperparameters(exploration=0.02, final_learning_rate=1.5e-5)
        for view, seed in itertools.product(VIEWS, seeds):
            static = dqn.DQNConfig(view=view, steps=config.view_steps, steps_per_update=32)
            seeded = dataclasses.replace(run, seed=seed)
            yield _expert(f"views/{view}/{seed}", static, seeded, cost=120.0)
    if "strengths" in config.parts:
        static = dataclasses.replace(preset, updates=config.updates)
        axes: Any = itertools.product(STRENGTHS, MODES, seeds)
        for strength, target, seed in axes:
            run = dataclasses.replace(numbers, strength=strength)
            name = f"strengths/{strength:g}/{target}/{seed}"
            yield _learner(config, name, static, run, target, seed, 75.0)
    cells = itertools.product(TARGET_KINDS, TEMPERATURES, ENDINGS, TARGETS)
    for kind, temperature, ending, target in cells if "targets" in config.parts else ():
        if target == "baseline" and kind != next(iter(TARGET_KINDS)):
            continue  # without a prior the kind of target means nothing
        endings = iq.Endings(arrival=ending, collision=ending, timeout=ending)
        static = dataclasses.replace(structure, target_kind=kind, endings=endings)
        run = dataclasses.replace(numbers, temperature=temperature)
        name = f"targets/{kind}/{temperature:g}/{ending}/{target}/{seeds[0]}"
        yield _learner(config, name, static, run, target, seeds[0], 40.0)
    pairs = [(mixture, size) for mixture, sizes in SIZES.items() for size in sizes]
    data = itertools.product(pairs, TARGETS, seeds) if "data" in config.parts else ()
    for (mixture, size), target, seed in data:
        changed = dataclasses.replace(config, mixture=mixture, size=size)
        name = f"data/{mixture}/{size}/{target}/{seed}"
        yield _learner(changed, name, structure, numbers, target, seed, 40.0)


def _expert(
    name: str, structure: dqn.DQNConfig, numbers: dqn.DQNHyperparameters, cost: float
) -> Job:
    return Job(name, train_expert, ExpertRun(structure, numbers), cost=cost)


def _learner(
    config: Any,
    name: str,
    structure: iq.IQLearnConfig,
    numbers: iq.IQLearnHyperparameters,
    target: str,
    seed: int,
    cost: float,
) -> Job:
    """Train a learner towards a mode's angle, or the baseline."""
    if target == "baseline":
        structure = presets.baseline(structure)
    numbers = dataclasses.replace(numbers, angle=MODES.get(target, 0.0), seed=seed)
    run = LearnerRun(structure, numbers, config.mixture, config.size)
    return Job(name, train_learner, run, (driving.DEMONSTRATIONS,), cost=cost)


def members(config: Any) -> dict[str, str]:
    """Return the folder of the job of each policy of the atlas: experts, and the first seed's."""
    experts = columns(config)["experts", "flat"]
    learners = columns(config)[SHIPPED]
    policies = {name.replace(" ", "_"): folders[0] for name, folders in experts.items()}
    return policies | {target: folders[0] for target, folders in learners.items()}
