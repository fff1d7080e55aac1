"""Rows of the comparison, its configuration, and each learner's settings at the common budget."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.dial import config as dial
from socialiq.learners.dqn import config as dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets
from socialiq_lab.comparison import GRIDWORLDS, check_choices


@dataclass(frozen=True)
class Method:
    """A row of the comparison: a learner, and its settings that differ from the world's.

    Attributes:
        name: Name of the row and of its folders.
        learner: Name of the learner in `gridworlds.LEARNERS` and `intersection.LEARNERS`.
        prior: Place of the social score in IQ-Learn.
        target_kind: Target of the score in IQ-Learn.
        shift_term_3: Whether the Bellman shift also enters term 3.
        scaled: Whether it has a λ (or 1/τ_w), which is then chosen on the development seeds.
        by_angle: Whether its training depends on the target angle; else one policy serves all.
        readouts: Evaluated action selections.
    """

    name: str
    learner: str
    prior: str = "none"
    target_kind: str = "instantaneous"
    shift_term_3: bool = False
    scaled: bool = True
    by_angle: bool = True
    readouts: tuple[str, ...] = ("greedy", "soft")


IQ = "iq_learn"
METHODS = (
    Method("none", IQ, scaled=False, by_angle=False),
    Method("thesis", IQ, "reward", "running", scaled=False),
    Method("running", IQ, "reward", "running"),
    Method("to_go", IQ, "reward", "to_go"),
    Method("trajectory", IQ, "reward", "trajectory"),
    Method("instantaneous", IQ, "reward", "instantaneous"),
    Method("advantage", IQ, "reward", "advantage"),
    Method("shifted_chi2", IQ, "shifted_chi2"),
    # In term 1 the shift has no gradient, whatever λ and angle (tests/identities).
    Method("bellman_shift", IQ, "bellman_shift", "running", scaled=False, by_angle=False),
    Method("bellman_shift_1_3", IQ, "bellman_shift", "running", shift_term_3=True),
    Method("reweighting", IQ, "reweighting", "running"),
    Method("dial", "dial"),
    Method("clone", "clone", scaled=False, by_angle=False),
    Method("clone_of_mode", "clone_of_mode", scaled=False),
    Method("clone_weighted", "clone_weighted"),
    Method("cql", "cql"),
    Method("rl", "rl", scaled=False, readouts=("greedy",)),  # its temperature has no meaning
)

BY_NAME = {method.name: method for method in METHODS}

LABELS = {
    "none": "IQ-Learn, no prior",
    "thesis": "running returns, the thesis' λ",
    "running": "running returns",
    "to_go": "returns-to-go",
    "trajectory": "whole-episode returns",
    "instantaneous": "instantaneous rewards",
    "advantage": "advantages",
    "shifted_chi2": "shifted χ², instantaneous",
    "bellman_shift": "Bellman shift, term 1",
    "bellman_shift_1_3": "Bellman shift, terms 1 and 3",
    "reweighting": "reweighting",
    "dial": "the dial, one network",
    "clone": "BC, pooled",
    "clone_of_mode": "BC of the nearest mode",
    "clone_weighted": "BC weighted by R(α)",
    "cql": "CQL on λ R(α)",
    "rl": "RL on R(α), no demonstrations",
}
"""Labels of the rows."""

THESIS_STRENGTHS = {
    "crossing5": presets.POC_STRENGTH,
    "crossing7": presets.GRID_STRENGTH,
    "intersection": presets.INTERSECTION_STRENGTH,
}
"""λ of each world's own study, also in the column of methods without one."""


FASTER = 3
"""Factor on the learning rates of 6.2, with a third of its updates: the table costs a third."""


@dataclass(frozen=True)
class Config:
    """One budget and the same seeds for every method of a world."""

    worlds: tuple[str, ...] = GRIDWORLDS
    """Worlds of the comparison; the intersection takes hours and is left out if not named."""
    methods: tuple[str, ...] = tuple(BY_NAME)
    """Names of `METHODS`."""
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """Target angles in degrees, in the gridworlds."""
    development_angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Angles at which λ is chosen, and all angles of the intersection."""
    strengths: tuple[float, ...] = (1.0, 3.0, 10.0)
    """λ that can be chosen, or 1/τ_w."""
    development_seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Training seeds on which λ is chosen, each with its own data set."""
    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds of the table, each with its own data set."""
    updates: int = presets.GRID.updates // FASTER
    """Gradient steps in the gridworlds, and as many steps in the world."""
    learning_rate: float = FASTER * presets.TABLE_C1_NUMBERS.learning_rate
    polyak: float = FASTER * presets.TABLE_C1_NUMBERS.polyak
    intersection_strengths: tuple[float, ...] = (1.0, 3.0)
    """λ that can be chosen in the intersection."""
    intersection_development_seeds: tuple[int, ...] = (0,)
    """Seeds on which λ is chosen in the intersection, where a run takes almost a minute."""
    intersection_seeds: tuple[int, ...] = (10, 11, 12)
    """Training seeds of the intersection's table."""
    intersection_updates: int = 4_000
    """Gradient steps of every method in the intersection, half of the study's."""
    episodes: int = 2000
    """Evaluation episodes of each policy in the intersection."""

    def __post_init__(self) -> None:
        """Refuse unknown worlds and methods, empty options, and seeds used twice."""
        development = (*self.development_seeds, *self.intersection_development_seeds)
        check_choices(self, tuple(BY_NAME), development, (*self.seeds, *self.intersection_seeds))

    @property
    def structure(self) -> iq.StaticConfig:
        """Static config of the gridworlds: Table C.1's, with the study's updates."""
        return dataclasses.replace(presets.TABLE_C1, updates=self.updates)

    @property
    def numbers(self) -> iq.Hyperparameters:
        """Hyperparameters that all runs of the gridworlds share."""
        return dataclasses.replace(
            presets.TABLE_C1_NUMBERS, learning_rate=self.learning_rate, polyak=self.polyak
        )


class Run(NamedTuple):
    """A training run: angle in degrees, λ (or 1/τ_w), seed, and number of its data set."""

    angle: float
    strength: float
    seed: int
    dataset: int


def settings(
    method: Method, base: iq.StaticConfig, rates: iq.Hyperparameters, run: Run
) -> tuple[Any, Any]:
    """Return the static config and the hyperparameters of a run, of its method's learner.

    Args:
        method: Row of the comparison.
        base: Network, batches, updates and environment steps, as IQ-Learn's static config.
        rates: Rates and discounts, as IQ-Learn's hyperparameters.
        run: Angle, strength, seed and data set.
    """
    rate = _values(rates, "learning_rate") | _values(run, "seed")
    scaled = _values(run, "strength", "dataset") | _values(rates, "temperature")
    values = rate | _values(rates, "discount", "polyak")
    weighing = _values(run, "angle", "dataset")
    weighing["reweight_temperature"] = 1 / run.strength
    offline = _values(base, *_NETWORK, "batch_size", "updates")
    match method.learner:
        case "iq_learn":
            changes = _values(method, "prior", "target_kind", "shift_term_3")
            return dataclasses.replace(base, **changes), dataclasses.replace(
                rates, seed=run.seed, **(scaled | weighing)
            )
        case "cql":
            conservative = cql.StaticConfig(endings=base.endings, **offline)
            return conservative, cql.Hyperparameters(angle=run.angle, **scaled, **values)
        case "rl":
            final = rates.learning_rate
            numbers = dqn.Hyperparameters(angle=run.angle, final_learning_rate=final, **values)
            return _reinforcement(base), numbers
        case "dial":  # its angle is given to the trained network
            return _dial(base), dial.Hyperparameters(final_rate=1.0, **scaled, **values)
    clone = bc.StaticConfig(weighted=method.learner == "clone_weighted", **offline)
    return clone, bc.Hyperparameters(**rate, **weighing)


_NETWORK = ("hidden", "activation", "view")


def _values(source: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(source, name) for name in names}


def _reinforcement(base: iq.StaticConfig) -> dqn.StaticConfig:
    """Return deep Q-learning with the updates and environment steps of the other rows."""
    return dqn.StaticConfig(
        **_values(base, *_NETWORK, "batch_size", "replay_capacity"),
        steps=base.updates * base.env_steps_per_update,
        steps_per_update=base.env_steps_per_update,
    )


def _dial(base: iq.StaticConfig) -> dial.StaticConfig:
    return dial.StaticConfig(
        **_values(base, *_NETWORK, "endings", "updates", "replay_capacity"),
        expert_batch=base.batch_size,
        replay_batch=base.batch_size,
        environments=base.env_steps_per_update,
    )
