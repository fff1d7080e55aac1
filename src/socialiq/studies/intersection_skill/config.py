"""Configuration of the study of the hidden skill; the defaults are the committed results."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from socialiq.errors import UserError, one_of
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.dial_jobs import NUMBERS, STRUCTURE
from socialiq.experiments.intersection.experts import finer
from socialiq.learners import behaviour_cloning as cloning
from socialiq.learners.dial import config as dial
from socialiq.learners.dqn import config as dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets

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

LEARNER = dataclasses.replace(STRUCTURE, updates=12_000, expert_batch=66, replay_batch=190)
"""Static config of every dial: the network of the dial study, 256 rows an update."""

DIAL_NUMBERS = dataclasses.replace(NUMBERS, shrinkage=0.3)
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
    """Demonstrated transitions of each demonstrator that a learner sees."""
    structure: dial.StaticConfig = LEARNER
    """Static config of every dial."""
    numbers: dial.Hyperparameters = DIAL_NUMBERS
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
    """Degrees between the angles that demonstrators' are inferred from."""
    steps_per_update: int = 12
    """Environment steps of a dial for each gradient step."""
    episodes: int = 2000
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
        for name in ("pool_episodes", "size", "grid", "steps_per_update", "episodes"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} must be at least 1, got {getattr(self, name)}")

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
