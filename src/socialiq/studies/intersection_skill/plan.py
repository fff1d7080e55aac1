"""Configuration and jobs of the study: do demonstrations add anything beyond RL on R(α)?

All demonstrators also drive smoothly and keep the junction clear (`skill.skill`), which neither
r_env nor r_social contains. Every method gets R(α); all but the first get the demonstrations of 0,
45 and 90 degrees. They are scored on R(α) + c h, also at angles without demonstrations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

from socialiq.errors import UserError, one_of
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.demonstration_sets import DEMONSTRATIONS, Recording
from socialiq.experiments.intersection.episodes import EPISODES
from socialiq.experiments.intersection.experts import finer
from socialiq.experiments.intersection.training import DIAL_NUMBERS, DIAL_STRUCTURE
from socialiq.experiments.jobs import Job
from socialiq.learners import behaviour_cloning as cloning
from socialiq.learners.config import check_counts
from socialiq.learners.dial import config as dial
from socialiq.learners.dqn import config as dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets
from socialiq.studies.intersection_skill.jobs import (
    CloneRun,
    DemonstratorRun,
    Inference,
    ReturnsRun,
    SkillDialRun,
    infer,
    record_demonstrators,
    train_clones,
    train_demonstrator,
    train_family,
    train_returns,
)
from socialiq.studies.intersection_skill.skill import ScoredRun, evaluate, unskilled_name
from socialiq.worlds.intersection import atlas

ALONE, PRIOR, RETURNS = "RL on R(α)", "prior on rewards", "prior on returns-to-go"
SHARED, INFERRED = "shared competence", "shared competence, angles inferred"
CLONES, EXPERTS, UNSKILLED = "clones", "demonstrators", "experts of R(α) alone"
METHODS = (ALONE, RETURNS, PRIOR, SHARED, INFERRED)
"""Compared methods: each gets R(α), and all but the first the demonstrations."""
REFERENCES = (CLONES, EXPERTS, UNSKILLED)
"""References with a policy for each demonstrated angle; elsewhere the nearest is used."""
FOLDERS = {
    ALONE: "alone",
    RETURNS: "returns",
    PRIOR: "prior",
    SHARED: "shared",
    INFERRED: "inferred",
    CLONES: "clones",
    EXPERTS: "experts",
    UNSKILLED: "unskilled",
}
"""Folder of the jobs of each method."""

LEARNER = dataclasses.replace(DIAL_STRUCTURE, updates=12_000, expert_batch=66, replay_batch=190)
"""Static config of every dial: the network of the dial study, 256 rows an update."""

NUMBERS = dataclasses.replace(DIAL_NUMBERS, shrinkage=0.3)
"""Rates of the same study. With a shrinkage of 0.1 or less, the shared reward f diverges while
Q lags behind it, and the result is imitation at R(α)'s expense."""

RETURNS_LEARNER = dataclasses.replace(
    presets.INTERSECTION_CALIBRATED,
    target_kind="to_go",
    view="set",
    hidden=(128, 128),
    batch_size=128,
    updates=3000,
)
RETURNS_NUMBERS = dataclasses.replace(presets.INTERSECTION_CALIBRATED_NUMBERS, strength=0.3)
"""The thesis' learner, on returns-to-go, one run for each angle; 256 rows an update."""

EXPERT = dqn.StaticConfig("set", (128, 128), steps=240_000, steps_per_update=12)
EXPERT_NUMBERS = finer(dqn.Hyperparameters(learning_rate=5e-4, polyak=0.01, seed=70))
"""Settings of a demonstrator: those of the experts that see a set (intersection-networks)."""

CLONE = cloning.StaticConfig(hidden=(128, 128), view="set", batch_size=256, updates=3000)
"""Static config of a clone."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (60, 61, 62, 63, 64)
    """Training seeds, each with its own draw of demonstrations. 0 and 1 were used in
    development."""
    methods: tuple[str, ...] = METHODS
    """Names of methods; RL on R(α) is always among them."""
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """Angles of the evaluation, in degrees; 0, 45 and 90 are demonstrated."""
    weight: float = 0.5
    """c: cost to the demonstrators of a change by one level of speed, or of a decision that ends
    standing in the junction, in units of reward."""
    expert_structure: dqn.StaticConfig = EXPERT
    """Static config of a demonstrator, trained on R(α) + c h."""
    expert_numbers: dqn.Hyperparameters = EXPERT_NUMBERS
    """Hyperparameters of a demonstrator, without the angle."""
    pool_episodes: int = 1500
    """Episodes recorded of each demonstrator."""
    size: int = 10_000
    """Transitions of each demonstrator that a learner gets."""
    structure: dial.StaticConfig = LEARNER
    """Static config of every dial."""
    numbers: dial.Hyperparameters = NUMBERS
    """Hyperparameters of every dial, without the seed."""
    prior_weight: float = 10.0
    """w of the prior on rewards."""
    returns_structure: iq.StaticConfig = RETURNS_LEARNER
    """Static config of the prior on returns-to-go."""
    returns_numbers: iq.Hyperparameters = RETURNS_NUMBERS
    """Hyperparameters of the prior on returns-to-go, without angle and seed."""
    clone_structure: cloning.StaticConfig = CLONE
    """Static config of the clones, one of each demonstrator."""
    grid: int = 5
    """Step in degrees of the grid from which the demonstrators' angles are inferred."""
    steps_per_update: int = 12
    """Environment steps of a dial for each gradient step."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the intersection study's own."""

    def __post_init__(self) -> None:
        """Refuse unknown methods and empty sizes."""
        for method in self.methods:
            one_of("method", method, METHODS)
        if ALONE not in self.methods or not self.seeds or not self.angles:
            raise UserError(f"the study needs seeds, angles, and {ALONE} to compare with")
        low, high = self.structure.low, self.structure.high
        if not all(low <= angle <= high for angle in self.angles):
            raise UserError(f"angles must lie in the dials' range, {low:g} to {high:g} degrees")
        check_counts(self, ("pool_episodes", "size", "grid", "steps_per_update", "episodes"))

    def dial_of(self, method: str) -> dial.StaticConfig:
        """Return the static config of a method's dial; all have equal rows an update."""
        one = self.structure
        if method == ALONE:
            rows = one.expert_batch + one.replay_batch
            return dataclasses.replace(one, demonstrations=False, replay_batch=rows)
        if method in (SHARED, INFERRED):
            return dataclasses.replace(one, demonstrators=tuple(MODES.values()))
        return one

    def numbers_of(self, method: str, seed: int) -> dial.Hyperparameters:
        """Return the hyperparameters of a method's dial."""
        changed = {"prior_weight": self.prior_weight} if method == PRIOR else {}
        return dataclasses.replace(self.numbers, seed=seed, **changed)


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    experts = [_expert(config, angle) for angle in MODES.values()]
    trained = tuple(job.name for job in experts)
    recording = Recording(episodes=config.pool_episodes, first_seed=11_000_000)
    jobs = [
        *experts,
        Job(DEMONSTRATIONS, record_demonstrators, recording, trained, 20.0),
    ]
    entries = atlas.manifest()
    sha256 = tuple(entries[unskilled_name(mode)]["sha256"] for mode in MODES)
    jobs += [_driving(config, FOLDERS[EXPERTS], trained)]
    jobs += [_driving(config, FOLDERS[UNSKILLED], (), sha256)]
    for seed in config.seeds:
        jobs += _learners(config, seed)
    return jobs


def _expert(config: Config, angle: float) -> Job:
    numbers = dataclasses.replace(config.expert_numbers, angle=angle)
    run = DemonstratorRun(config.expert_structure, numbers, config.weight)
    cost = config.expert_structure.updates / 150
    return Job(f"{FOLDERS[EXPERTS]}/{angle:g}", train_demonstrator, run, cost=cost)


def _driving(
    config: Config, name: str, inputs: tuple[str, ...], sha256: tuple[str, ...] = ()
) -> Job:
    driving = ScoredRun(config.angles, sha256, episodes=config.episodes)
    return Job(f"evaluation/{name}", evaluate, driving, inputs, cost=2.0 * len(config.angles))


def _learners(config: Config, seed: int) -> Iterator[Job]:
    """Train and drive every learner of a seed."""
    makers = {RETURNS: _returns, CLONES: _clones}
    for method in (*config.methods, CLONES):
        name = f"{FOLDERS[method]}/{seed}"
        if method in makers:
            yield makers[method](config, name, seed)
        else:
            yield from _dial(config, method, seed)
        yield _driving(config, name, (name,))


def _dial(config: Config, method: str, seed: int) -> Iterator[Job]:
    """Train a dial; where angles are inferred, run an E-step before it and one after it."""
    structure, numbers = config.dial_of(method), config.numbers_of(method, seed)
    learning = SkillDialRun(
        structure=structure,
        numbers=numbers,
        size=config.size,
        steps_per_update=config.steps_per_update,
        weight=config.weight,
    )
    name, inputs = (
        f"{FOLDERS[method]}/{seed}",
        (DEMONSTRATIONS,) if structure.demonstrations else (),
    )
    step = Inference(config.size, seed, config.grid)
    if method == INFERRED:
        before = f"angles/0/{seed}"
        yield Job(before, infer, step, (f"{FOLDERS[ALONE]}/{seed}", DEMONSTRATIONS))
        inputs = (DEMONSTRATIONS, before)
    yield Job(name, train_family, learning, inputs, cost=structure.updates / 80)
    if method == INFERRED:
        yield Job(f"angles/1/{seed}", infer, step, (name, DEMONSTRATIONS))


def _returns(config: Config, name: str, seed: int) -> Job:
    numbers = tuple(
        dataclasses.replace(config.returns_numbers, angle=angle, seed=seed)
        for angle in config.angles
    )
    run = ReturnsRun(config.returns_structure, numbers, config.size)
    cost = len(numbers) * config.returns_structure.updates / 100
    return Job(name, train_returns, run, (DEMONSTRATIONS,), cost=cost)


def _clones(config: Config, name: str, seed: int) -> Job:
    run = CloneRun(config.clone_structure, config.size, seed)
    return Job(name, train_clones, run, (DEMONSTRATIONS,), cost=config.clone_structure.updates / 50)
