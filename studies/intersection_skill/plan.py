"""Configuration and jobs of the study: do demonstrations add anything beyond RL on R(α)?

All demonstrators also drive smoothly and keep the junction clear (`skill.skill`), which neither
r_env nor r_social contains. Every method gets R(α); all but the first get the demonstrations of 0,
45 and 90 degrees. They are scored on R(α) + c h, also at angles without demonstrations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field

from socialiq.errors import UserError, one_of
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners import behaviour_cloning as cloning
from socialiq.learners import clone_dial
from socialiq.learners.config import check_counts
from socialiq.learners.dial import config as dial
from socialiq.learners.dqn import config as dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets
from socialiq.learners.policy_iteration import config as iteration
from socialiq.learners.policy_iteration import dial as dial_iteration
from socialiq.worlds.intersection import atlas
from socialiq_lab.intersection.demonstration_sets import DEMONSTRATIONS, Recording
from socialiq_lab.intersection.episodes import EPISODES
from socialiq_lab.intersection.experts import finer
from socialiq_lab.intersection.policy_iteration import ITERATION, ITERATION_NUMBERS
from socialiq_lab.intersection.training import DIAL_NUMBERS, DIAL_STRUCTURE
from socialiq_lab.jobs import Job
from studies.intersection_skill.improvement import (
    Choice,
    CloneDialRun,
    IterationRun,
    LeftOutRun,
    choose,
    improve,
    predict_left_out,
    train_clone_dial,
)
from studies.intersection_skill.jobs import (
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
from studies.intersection_skill.skill import ScoredRun, evaluate, unskilled_name

ALONE, PRIOR, RETURNS = "RL on R(α)", "prior on rewards", "prior on returns-to-go"
SHARED, INFERRED = "shared competence", "shared competence, angles inferred"
CLONES, EXPERTS, UNSKILLED = "clones", "demonstrators", "experts of R(α) alone"
TURNED, IMPROVED = "clone of every angle", "improved clone"
METHODS = (ALONE, RETURNS, PRIOR, SHARED, INFERRED)
"""Compared methods: each gets R(α), and all but the first the demonstrations."""
LATER = (TURNED, IMPROVED)
"""Methods with committed results of their own: a clone of all demonstrators as one dial, and what
policy iteration makes of it in the simulator."""
REFERENCES = (CLONES, EXPERTS, UNSKILLED)
"""References with a policy for each demonstrated angle; elsewhere the nearest is used."""
FOLDERS = {
    ALONE: "alone",
    RETURNS: "returns",
    PRIOR: "prior",
    SHARED: "shared",
    INFERRED: "inferred",
    TURNED: "turned",
    IMPROVED: "improved",
    CLONES: "clones",
    EXPERTS: "experts",
    UNSKILLED: "unskilled",
}
"""Folder of the jobs of each method."""
CHOSEN = "choice/price"
"""Folder of the choice of η."""

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

IMPROVEMENT = dataclasses.replace(
    ITERATION, view="set", hidden=(128, 128), updates=3000, first_rounds=3
)
"""Static config of the policy iteration of a clone."""

IMPROVEMENT_NUMBERS = dataclasses.replace(ITERATION_NUMBERS, temperature=1.0)
"""Hyperparameters beside it: outputs are log-probabilities."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (60, 61, 62, 63, 64)
    """Training seeds, each with its own draw of demonstrations. 0 and 1 were used in
    development."""
    methods: tuple[str, ...] = METHODS
    """Names of methods; with any of the first five RL on R(α) is always among them."""
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
    turned_structure: clone_dial.StaticConfig = field(default_factory=clone_dial.StaticConfig)
    """Static config of the clone of every angle."""
    improved_structure: dial_iteration.StaticConfig = IMPROVEMENT
    """Static config of the policy iteration."""
    improved_numbers: iteration.Hyperparameters = IMPROVEMENT_NUMBERS
    """Hyperparameters of the policy iteration, without the seed."""
    prices: tuple[float, ...] = (0.1, 0.2, 0.4)
    """Candidates of η, in units of reward for a nat; the choice is by prediction."""
    left_out_updates: int = 400
    """Updates of the policies that predict a demonstrator that is left out."""
    grid: int = 5
    """Step in degrees of the grid from which the demonstrators' angles are inferred."""
    steps_per_update: int = 12
    """Environment steps of a dial for each gradient step."""
    episodes: int = EPISODES
    """Evaluation episodes of each policy, the intersection study's own."""

    def __post_init__(self) -> None:
        """Refuse unknown methods and empty sizes."""
        for method in self.methods:
            one_of("method", method, (*METHODS, *LATER))
        alone = ALONE in self.methods or set(self.methods) <= set(LATER)
        if not (alone and self.methods and self.seeds and self.angles):
            raise UserError(f"the study needs seeds, angles, and {ALONE} to compare with")
        low, high = self.structure.low, self.structure.high
        if not all(low <= angle <= high for angle in self.angles):
            raise UserError(f"angles must lie in the dials' range, {low:g} to {high:g} degrees")
        names = ("pool_episodes", "size", "grid", "steps_per_update", "episodes")
        check_counts(self, (*names, "left_out_updates"))
        if not self.prices or min(self.prices) <= 0.0:
            raise UserError("name at least one price η, all above 0")

    @property
    def references(self) -> tuple[str, ...]:
        """Return the references; clones are trained beside RL on R(α) only."""
        return REFERENCES if ALONE in self.methods else (EXPERTS, UNSKILLED)

    @property
    def trained(self) -> tuple[str, ...]:
        """Return the methods and references that are trained for each seed."""
        return (*self.methods, *(one for one in self.references if one == CLONES))

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
    return [*jobs, *_improvement(config)]


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
    for method in (one for one in config.trained if one not in LATER):
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


def _improvement(config: Config) -> Iterator[Job]:
    """Clone at every angle, choose η on the demonstrations of the first seed, and improve."""
    if IMPROVED in config.methods:
        yield from _choice(config)
    for seed in config.seeds:
        for method in (one for one in LATER if {one, IMPROVED} & set(config.methods)):
            name = f"{FOLDERS[method]}/{seed}"
            yield _turned(config, name, seed) if method == TURNED else _improved(config, seed)
            if method in config.methods:
                yield _driving(config, name, (name,))


def _turned(config: Config, name: str, seed: int) -> Job:
    run = CloneDialRun(config.turned_structure, config.size, seed)
    return Job(name, train_clone_dial, run, (DEMONSTRATIONS,), cost=run.structure.updates / 80)


def _choice(config: Config) -> Iterator[Job]:
    names = []
    short = dataclasses.replace(config.improved_structure, updates=config.left_out_updates)
    for mode in MODES:
        run = LeftOutRun(
            structure=short,
            numbers=dataclasses.replace(config.improved_numbers, seed=config.seeds[0]),
            clone=config.turned_structure,
            mode=mode,
            prices=config.prices,
            size=config.size,
        )
        names.append(f"left-out/{mode}")
        cost = len(config.prices) * short.updates / 30
        yield Job(names[-1], predict_left_out, run, (DEMONSTRATIONS,), cost=cost)
    yield Job(CHOSEN, choose, Choice(), tuple(names))


def _improved(config: Config, seed: int) -> Job:
    run = IterationRun(
        structure=config.improved_structure,
        numbers=dataclasses.replace(config.improved_numbers, seed=seed),
    )
    name, inputs = f"{FOLDERS[IMPROVED]}/{seed}", (f"{FOLDERS[TURNED]}/{seed}", CHOSEN)
    return Job(name, improve, run, inputs, cost=run.structure.updates / 30)
