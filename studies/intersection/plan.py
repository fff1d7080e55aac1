"""Configuration of the intersection study, its jobs, and the names of their folders."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

from socialiq.demonstrations.mixture import MIXTURES
from socialiq.errors import UserError, one_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners import dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import config as presets
from socialiq.nn.view import CHOICES
from socialiq.social.returns import TARGET_KINDS
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import NAMES
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    MIXTURE,
    RECORDED_EPISODES,
    SIZE,
    Recording,
    record_demonstrations,
)
from socialiq_lab.intersection.driving import EPISODES, HIGHWAY_EPISODES, Evaluation, evaluate
from socialiq_lab.intersection.experts import (
    EXPERT_STEPS,
    evaluations,
    expert_name,
    finer,
    flat_expert,
    on_highway,
    policy_file,
)
from socialiq_lab.intersection.training import (
    ExpertRun,
    LearnerRun,
    train_expert,
    train_learner,
)
from socialiq_lab.jobs import Job

PARTS = ("main", "strengths", "targets", "data", "timeouts", "views")
"""Parts of the study.

- main: an expert trio, its demonstrations, the thesis' preset and the calibrated one with five
  training seeds, every policy and driver evaluated: Tables 6.1, 6.2, A.1, A.2, Figs 6.5, A.1.
- strengths: lambda raised until the angle stops moving.
- targets: kinds of target, temperatures, values of ending.
- data: how much demonstration is needed, and which mixture.
- timeouts: experts that bootstrap through the end of time.
- views: changes between the flat network and one that reads a set of vehicles, one by one.
"""


@dataclass(frozen=True)
class Config:
    """Configuration of the study. Seeds below 10, 20 and above 100 were used in development."""

    parts: tuple[str, ...] = PARTS
    """Parts to run; main is always among them."""
    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds of learners, each with a mixture of its own."""
    expert_seed: int = 40
    """Training seed of the expert trio that gives the demonstrations."""
    ablation_seeds: tuple[int, ...] = (30, 31)
    """Training seeds of the ablations."""
    expert_steps: int = EXPERT_STEPS
    """Environment steps of the trio (thesis 5.2)."""
    view_steps: int = 600_000
    """Environment steps of the ablation of views."""
    updates: int = presets.INTERSECTION_THESIS.updates
    """Gradient steps of a learner."""
    ablation_updates: int = 4_000
    """Gradient steps of a learner in the parts targets and data."""
    pool_episodes: int = RECORDED_EPISODES
    """Episodes recorded of each expert."""
    mixture: str = MIXTURE
    """Unit of which each expert has an equal number; the thesis names transitions (6.3)."""
    size: int = SIZE
    """Transitions of each expert in a mixture, or episodes with mixture "equal_trajectories"."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the same for all."""
    evaluation_seeds: int = 5
    """Groups of evaluation episodes, as the thesis' five evaluation seeds."""
    group_episodes: int = 100
    """Episodes of a group; the thesis does not give the number."""
    highway_episodes: int = HIGHWAY_EPISODES
    """Episodes of each final policy on the real highway-env; 0 leaves that out."""

    def __post_init__(self) -> None:
        """Refuse unknown parts and empty sizes."""
        for name_of_part in self.parts:
            one_of("part", name_of_part, PARTS)
        one_of("mixture", self.mixture, tuple(MIXTURES))
        for name, value in vars(self).items():
            least = 0 if name in ("highway_episodes", "expert_seed") else 1
            if isinstance(value, int) and value < least:
                raise UserError(f"{name} must be at least {least}, got {value}")
            if isinstance(value, tuple) and not value:
                raise UserError(f"{name} must name at least one")


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


def jobs(config: Config) -> list[Job]:
    """Return every job of the chosen parts, each after its inputs."""
    trainings = list(_main(config))
    for name_of_part, make in _ABLATIONS.items():
        if name_of_part in config.parts:
            trainings += make(config)
    taken = members(config)
    return [
        *trainings,
        *evaluations(trainings, config.episodes),
        *_drivers(config),
        *_connected(config),
        *on_highway(taken, config.highway_episodes),
    ]


def learner_name(preset: str, setting: str, target: str, seed: int) -> str:
    """Return the folder of a learner of the main part."""
    return f"learners/{preset}/{setting}/{target}/{seed}"


def columns(config: Config) -> dict[tuple[str, str], dict[str, list[str]]]:
    """Return the policies behind each column of Table 6.2, for experts and groups of learners."""
    policies = {
        ("experts", "flat"): {
            f"expert {mode}": [expert_name("flat", mode, config.expert_seed)] for mode in MODES
        }
    }
    for preset, setting in TRAINED:
        policies[preset, setting] = {
            target: [learner_name(preset, setting, target, seed) for seed in config.seeds]
            for target in TARGETS
        }
    return policies


def _main(config: Config) -> Iterator[Job]:
    first = config.expert_seed
    yield from (flat_expert(mode, first, config.expert_steps) for mode in MODES)
    experts = tuple(expert_name("flat", mode, first) for mode in MODES)
    recording = Recording(episodes=config.pool_episodes)
    yield Job(DEMONSTRATIONS, record_demonstrations, recording, experts, cost=20.0)
    for (preset, setting), target in itertools.product(TRAINED, TARGETS):
        structure, numbers = PRESETS[preset]
        structure = dataclasses.replace(structure, updates=config.updates)
        if setting == "offline":
            structure = presets.offline(structure)
        for seed in config.seeds:
            run = _learner(config, structure, numbers, target, seed)
            name = learner_name(preset, setting, target, seed)
            yield _job(name, run, 80.0 if structure.online else 45.0)


def _timeouts(config: Config) -> Iterator[Job]:
    """Train the experts that can gain by waiting, now bootstrapping through timeouts."""
    for mode, angle in list(MODES.items())[1:]:
        structure = dqn.DQNConfig(steps=config.expert_steps // 2, through_timeouts=True)
        run = ExpertRun(structure, dqn.DQNHyperparameters(angle=angle, seed=config.expert_seed))
        name = f"timeouts/through/{mode}/{config.expert_seed}"
        yield Job(name, train_expert, run, cost=450.0)


def _views(config: Config) -> Iterator[Job]:
    for view, seed in itertools.product(VIEWS, config.ablation_seeds):
        structure = dqn.DQNConfig(view=view, steps=config.view_steps, steps_per_update=32)
        run = ExpertRun(structure, finer(dqn.DQNHyperparameters(seed=seed)))
        yield Job(f"views/{view}/{seed}", train_expert, run, cost=120.0)


def _strengths(config: Config) -> Iterator[Job]:
    structure, numbers = _ablated(config.updates)
    for strength, target in itertools.product(STRENGTHS, MODES):
        changed = dataclasses.replace(numbers, strength=strength)
        for seed in config.ablation_seeds:
            run = _learner(config, structure, changed, target, seed)
            yield _job(f"strengths/{strength:g}/{target}/{seed}", run, 75.0)


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
        yield _job(f"targets/{kind}/{temperature:g}/{ending}/{target}/{seed}", run, 40.0)


def _data(config: Config) -> Iterator[Job]:
    structure, numbers = _ablated(config.ablation_updates)
    cells = [(mixture, size) for mixture, sizes in SIZES.items() for size in sizes]
    for (mixture, size), target in itertools.product(cells, TARGETS):
        for seed in config.ablation_seeds:
            run = _learner(config, structure, numbers, target, seed)
            run = dataclasses.replace(run, mixture=mixture, size=size)
            yield _job(f"data/{mixture}/{size}/{target}/{seed}", run, 40.0)


def _drivers(config: Config) -> Iterator[Job]:
    for name in NAMES:
        run = Evaluation(name, ("greedy",), episodes=config.episodes)
        yield Job(f"evaluation/drivers/{name}", evaluate, run, cost=3.0)


def _connected(config: Config) -> Iterator[Job]:
    """The atlas' policies in traffic with connected lanes."""
    for name, job in members(config).items():
        options = Options(connected_lanes=True)
        run = Evaluation(policy_file(job), ("greedy",), episodes=config.episodes, options=options)
        yield Job(f"connected/{name}", evaluate, run, (job,), cost=3.0)


def members(config: Config) -> dict[str, str]:
    """Return the folder of the job of each policy of the atlas, by its name there.

    Experts, and the first training seed's baseline and trio.
    """
    experts, learners = columns(config)["experts", "flat"], columns(config)[SHIPPED]
    policies = {name.replace(" ", "_"): folders[0] for name, folders in experts.items()}
    return policies | {target: folders[0] for target, folders in learners.items()}


def _ablated(updates: int) -> tuple[iq.IQLearnConfig, iq.IQLearnHyperparameters]:
    """Return the calibrated preset, which the ablations vary."""
    structure, numbers = PRESETS["calibrated"]
    return dataclasses.replace(structure, updates=updates), numbers


def _learner(
    config: Config,
    structure: iq.IQLearnConfig,
    numbers: iq.IQLearnHyperparameters,
    target: str,
    seed: int,
) -> LearnerRun:
    if target == "baseline":
        structure, angle = presets.baseline(structure), 0.0
    else:
        angle = MODES[target]
    numbers = dataclasses.replace(numbers, angle=angle, seed=seed)
    return LearnerRun(structure, numbers, config.mixture, config.size)


def _job(name: str, run: LearnerRun, cost: float) -> Job:
    return Job(name, train_learner, run, (DEMONSTRATIONS,), cost=cost)


_ABLATIONS = {
    "timeouts": _timeouts,
    "views": _views,
    "strengths": _strengths,
    "targets": _targets,
    "data": _data,
}
"""Jobs of each part beside main."""
