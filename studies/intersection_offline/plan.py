"""Jobs of the study of offline dials, each after its inputs."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.settings import check_counts
from socialiq.worlds.intersection import atlas
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    RECORDED_EPISODES,
    SIZE,
    atlas_demonstrations,
)
from socialiq_lab.intersection.driving import (
    LAST,
    DialEvaluation,
    Evaluation,
    evaluate,
    evaluate_dial,
)
from socialiq_lab.intersection.offline_training import (
    AtlasMember,
    CloneRuns,
    IQLearnRuns,
    OfflineDialRuns,
    copy_of_atlas,
    run_file,
    train_clones,
    train_iq_learn,
    train_offline_dials,
)
from socialiq_lab.jobs import Job

METHODS = (
    "clone weighted by R(α)",
    "IQ-Learn, dueling",
    "IQ-Learn, dueling, reweighted",
    "clone weighted by advantage",
    "IQ-Learn",
    "clone of the mode",
    "clone of all",
    "IQ-Learn online, dueling",
    "IQ-Learn online",
    "IQ-Learn online, shifted χ²",
)
"""Methods beside the dial, with a run for each angle; the last three act in the world."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (65, 66, 67, 68, 69)
    """Training seeds, each with a mixture of demonstrations of its own. 60 to 64 were used by
    earlier versions, 100 to 102 in development."""
    angles: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 15.0).tolist())
    """Angles at which the dial is driven, in degrees."""
    methods: tuple[str, ...] = METHODS
    """Methods beside the dial: each is trained for each of its angles."""
    method_angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Angles of these methods: those of the demonstrators."""
    structure: OfflineDialConfig = field(default_factory=OfflineDialConfig)
    """Static config of the dial, and the networks of all."""
    numbers: OfflineDialHyperparameters = field(default_factory=OfflineDialHyperparameters)
    """Hyperparameters of the dial, without the seed."""
    updates: int = 5000
    """Gradient steps of clones and of IQ-Learn."""
    learning_rate: float = 1e-3
    """Adam's learning rate of clones and of IQ-Learn."""
    together: int = 5
    """Training seeds in one program: it is compiled once. Another number gives equal results but
    for rounding."""
    pool_episodes: int = RECORDED_EPISODES
    """Episodes recorded of each expert of the atlas, as in the intersection study."""
    size: int = SIZE
    """Transitions of each expert in a mixture."""
    episodes: int = 4000
    """Evaluation episodes of each policy, common to all."""
    first_episode: int = 60_000_000
    """Seed of the first one. Those from 50,000,000 on were used in development."""

    def __post_init__(self) -> None:
        """Refuse empty sizes and unknown methods."""
        if not self.seeds or not self.angles:
            raise UserError("name at least one training seed and one angle")
        if not set(self.method_angles) <= set(self.angles):
            raise UserError("every method angle must be among the angles of the dial")
        for method in self.methods:
            one_of("method", method, METHODS)
        check_counts(self, ("updates", "together", "pool_episodes", "size", "episodes"))

    @property
    def groups(self) -> list[tuple[int, ...]]:
        """Return the training seeds of each program."""
        return [
            self.seeds[first : first + self.together]
            for first in range(0, len(self.seeds), self.together)
        ]


def runs_of(config: Config, method: str, seeds: tuple[int, ...]) -> CloneRuns | IQLearnRuns:
    """Return the training runs of a method; a clone of all is one for every angle."""
    angles = config.method_angles[:1] if method == "clone of all" else config.method_angles
    kind = _clones if method.startswith("clone") else _iq_learn
    return kind(config, method)(seeds=seeds, angles=angles, size=config.size)


def _clones(config: Config, method: str) -> Callable[..., CloneRuns]:
    """Return clones of all demonstrators, of one, or of all with weights."""
    structure = bc.CloningConfig(
        weighted="weighted" in method,
        weighted_by="advantage_fitted" if method.endswith("advantage") else "trajectory",
        hidden=config.structure.hidden,
        view=config.structure.view,
        batch_size=config.structure.batch_size,
        updates=config.updates,
    )
    numbers = bc.CloningHyperparameters(learning_rate=config.learning_rate)
    nearest = method == "clone of the mode"
    return lambda **runs: CloneRuns(structure=structure, numbers=numbers, nearest=nearest, **runs)


def _iq_learn(config: Config, method: str) -> Callable[..., IQLearnRuns]:
    """Return IQ-Learn with a preset of the intersection."""
    shifted = method.endswith("shifted χ²")
    structure, numbers = presets.PRESETS[f"intersection-{'shifted' if shifted else 'calibrated'}"]
    if "online" not in method:
        structure = presets.offline(structure)
    structure = dataclasses.replace(
        structure,
        form="dueling" if "dueling" in method else "plain",
        hidden=config.structure.hidden,
        view=config.structure.view,
        updates=config.updates,
    )
    if method.endswith("reweighted"):  # Eq B.2, by the weights of the clone
        structure = dataclasses.replace(structure, prior="reweighting", target_kind="trajectory")
    numbers = dataclasses.replace(numbers, learning_rate=config.learning_rate)
    return lambda **runs: IQLearnRuns(structure=structure, numbers=numbers, **runs)


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    jobs = [atlas_demonstrations(config.pool_episodes)]
    entries = atlas.manifest()
    for mode in MODES:
        name = f"expert_{mode}"
        member = AtlasMember(name, entries[name]["sha256"])
        jobs.append(Job(f"demonstrators/{mode}", copy_of_atlas, member))
        jobs.append(_evaluation(config, demonstrator_episodes(mode), jobs[-1].name, LAST))
    for seeds in config.groups:
        jobs += _dials(config, seeds)
        for method in config.methods:
            jobs += _method(config, method, seeds)
    return jobs


def _evaluation(config: Config, name: str, trained: str, driver: str) -> Job:
    evaluation = Evaluation(
        driver, ("greedy",), episodes=config.episodes, first_seed=config.first_episode
    )
    return Job(name, evaluate, evaluation, (trained,), cost=2.0)


def _dials(config: Config, seeds: tuple[int, ...]) -> Iterator[Job]:
    """Yield the training of some dials and the driving of each."""
    structure = config.structure
    runs = OfflineDialRuns(
        structure=structure, numbers=config.numbers, seeds=seeds, size=config.size
    )
    name, cost = f"dials/{seeds[0]}", len(seeds) * structure.updates / 80
    yield Job(name, train_offline_dials, runs, (DEMONSTRATIONS,), cost=cost)
    for seed in seeds:
        driving = DialEvaluation(
            config.angles,
            run_file(seed),
            episodes=config.episodes,
            first_seed=config.first_episode,
        )
        cost = 2.0 * len(config.angles)
        yield Job(dial_episodes(seed), evaluate_dial, driving, (name,), cost=cost)


def _method(config: Config, method: str, seeds: tuple[int, ...]) -> Iterator[Job]:
    """Yield the training of some runs of a method, and the evaluation of each."""
    runs = runs_of(config, method, seeds)
    name = f"learners/{_slug(method)}/{seeds[0]}"
    work = train_clones if isinstance(runs, CloneRuns) else train_iq_learn
    cost = len(seeds) * len(runs.angles) * config.updates / 300
    yield Job(name, work, runs, (DEMONSTRATIONS,), cost=cost)
    for seed, angle in itertools.product(seeds, runs.angles):
        folder = method_episodes(method, seed, angle)
        yield _evaluation(config, folder, name, run_file(seed, angle))


def _slug(method: str) -> str:
    name = method.replace("R(α)", "total").replace("χ²", "chi2")
    return name.replace(",", "").replace(" ", "-")


def demonstrator_episodes(mode: str) -> str:
    """Return the folder of a demonstrator's episodes."""
    return f"evaluation/demonstrators/{mode}"


def dial_episodes(seed: int) -> str:
    """Return the folder of a dial's episodes."""
    return f"evaluation/dials/{seed}"


def method_episodes(method: str, seed: int, angle: float) -> str:
    """Return the folder of the episodes of a method's run."""
    return f"evaluation/learners/{_slug(method)}/{seed}/{angle:g}"
