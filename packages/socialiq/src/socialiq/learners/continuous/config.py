"""Settings of the learners of continuous actions, and presets of the intersection.

The presets were chosen with acceleration alone (docs/reproduction/intersection-continuous.md).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.iq_learn.config import Endings, IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.settings import Count, Natural, NotNegative, Positive

CUT = Endings(timeout="bootstrap")
"""A time limit cuts an episode off: the usual reading where observations don't show the time."""


@dataclass(frozen=True, kw_only=True)
class ActorConfig(settings.DrawnAngles):
    """Choices that all learners of continuous actions have. Only a dial reads the angles."""

    hidden: settings.Widths = (256, 256)
    """Widths of the hidden layers, of the actor and of each critic."""
    batch_size: Count = 256
    """Transitions of an update: demonstrations, own ones, or as many of each."""
    updates: Count = 20_000
    """Gradient steps of a run."""
    endings: Endings = CUT
    """Value of V(s') after each kind of ending."""
    dial: bool = False
    """Whether one network is trained for all angles from `low` to `high`: it then also reads
    (cos α, sin α), and each row of an update has an angle drawn for it."""
    actions_per_state: Count = 1
    """Actions that are drawn for the expectation over the policy in a state."""
    tuned: bool = False
    """Whether the temperature is tuned so that the policy has the entropy `entropy_target`; the
    given temperature is then the first."""
    times: Natural = 0
    """Number of values of the time, the last feature, which a view of vehicles reads one-hot: 0, 1,
    ..., times - 1. 0: observations don't show the time."""
    random_steps: Natural = 1000
    """First steps in the world with uniform actions."""
    updates_per_round: Count = 500
    """Updates between two rounds of acting in a Gymnasium environment. Each round begins with a
    reset, so its steps should be several episodes long."""

    def __post_init__(self) -> None:
        """Refuse sizes and angles that make no run."""
        super().__post_init__()
        self.check_high_share()


@dataclass(frozen=True, kw_only=True)
class SACConfig(ActorConfig, settings.LearnerConfig, settings.Replay):
    """Choices that shape the program of soft actor-critic."""

    env_steps_per_update: Count = 1
    """Steps the learner takes in the world before each gradient step."""


@dataclass(frozen=True, kw_only=True)
class TD3BCConfig(ActorConfig, settings.LearnerConfig):
    """Choices that shape the program of TD3+BC."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        super().__post_init__()
        if self.tuned:
            raise UserError("TD3+BC has no temperature to tune: leave out --set tuned=true")


@dataclass(frozen=True, kw_only=True)
class ActorIQLearnConfig(ActorConfig, IQLearnConfig):
    """Choices that shape the program of continuous IQ-Learn."""

    critic: Literal["objective", "regression"] = "objective"
    """Loss of the critics: terms 1 to 3 of Eq 2.7, or the regression of r̂ to 4 α_χ on
    demonstrations and to -4 α_χ on own rows, which terms 1 to 3 are where own rows are drawn from
    the policy (Al-Hafez et al. 2023, LS-IQ); with `bounded` its targets are bounded."""
    replay_capacity: Count = 100_000
    target_kind: Any = "instantaneous"
    """Kind of "cumulative returns" in R(α), of `social.returns`, or the advantage."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and combinations that make no run."""
        super().__post_init__()
        if self.form != "plain":
            raise UserError(f"--set form={self.form} is of discrete actions: leave it out")
        derived = (self.prior, self.divergence, self.chi2_on) == ("none", "chi2", "mixture")
        derived = derived and self.online and self.value_term == "value"
        if self.critic == "regression" and not derived:
            raise UserError(
                "the regression of r̂ follows from the objective with --world, --prior none, "
                "--divergence chi2, --set chi2_on=mixture and --value-term value: choose these"
            )
        if self.dial and self.prior in ("none", "reweighting"):
            raise UserError(
                f"prior {self.prior} has no angle of a row: a dial needs --prior reward, "
                "bellman_shift or shifted_chi2"
            )


@dataclass(frozen=True, kw_only=True)
class ActorRate(settings.Settings):
    """Learning rate of the actor."""

    actor_rate: Positive = 1.0
    """Learning rate of the actor, as a share of `learning_rate`, which critics and a tuned
    temperature have (Garg et al. 2021 take 0.1)."""


@dataclass(frozen=True, kw_only=True)
class Tuning(ActorRate):
    """Numbers of a tuned temperature."""

    entropy_target: settings.Finite = -1.0
    """Entropy for each number of an action that a tuned temperature leads to; uniform actions have
    log 2 (Haarnoja et al. 2018 take -1)."""


@dataclass(frozen=True, kw_only=True)
class TowardsData(ActorRate):
    """Numbers of TD3+BC. Defaults: Fujimoto and Gu 2021."""

    q_weight: NotNegative = 2.5
    """α of the paper: weight of Q, over its mean size, beside the squared distance of actions."""
    target_noise: NotNegative = 0.2
    """Deviation of the noise on the target policy's actions."""
    noise_clip: Positive = 0.5
    """Greatest size of that noise."""


@dataclass(frozen=True, kw_only=True)
class SACHyperparameters(Tuning, settings.LearnerHyperparameters):
    """Numbers of a run of soft actor-critic; all are traced."""

    temperature: Positive = 0.2
    """τ: weight of the entropy beside R(α), in units of reward."""


@dataclass(frozen=True, kw_only=True)
class ActorIQLearnHyperparameters(Tuning, IQLearnHyperparameters):
    """Numbers of a run of continuous IQ-Learn; all are traced."""

    temperature: Positive = 0.1
    """τ of V(s) = E_π[Q - τ log π]."""


@dataclass(frozen=True, kw_only=True)
class TD3BCHyperparameters(TowardsData, settings.LearnerHyperparameters):
    """Numbers of a run of TD3+BC; all are traced."""


STEPS_PER_UPDATE = 12
"""Environment steps for each update, of experts and dials with either kind of actions."""

_NETWORK: dict[str, Any] = {
    "view": "set",
    "hidden": (128, 128),
    "batch_size": 128,
    "endings": Endings(),
}

EXPERT = SACConfig(
    **_NETWORK,
    times=20,
    updates=3_000,
    env_steps_per_update=STEPS_PER_UPDATE,
    updates_per_round=200,
    replay_capacity=40_000,
    schedule="linear",
)
"""Soft actor-critic on R(α), which sees the time."""

EXPERT_NUMBERS = SACHyperparameters(
    temperature=0.03, learning_rate=2e-3, polyak=0.03, discount=0.99
)
"""Of experts and dials."""

DIAL = dataclasses.replace(EXPERT, high_share=0.4)
"""The same, once it is made a dial, with the angles of the preset of discrete actions."""

LEARNER = ActorIQLearnConfig(
    **_NETWORK,
    prior="shifted_chi2",
    chi2_on="mixture",
    updates=1_200,
    env_steps_per_update=2,
    updates_per_round=200,
    replay_capacity=20_000,
    target_kind="instantaneous",
)
"""The preset `intersection-shifted` with an actor; without the time, as its demonstrations."""

LEARNER_NUMBERS = ActorIQLearnHyperparameters(temperature=0.1, learning_rate=3e-4, prior_weight=5.0)

LONGER = dataclasses.replace(LEARNER, updates=EXPERT.updates)
LONGER_NUMBERS = dataclasses.replace(LEARNER_NUMBERS, learning_rate=2e-3)
"""The same with as many updates as an expert, and its rate."""

NAME = "intersection-continuous"

PRESETS: dict[str, dict[str, tuple[Any, Any]]] = {
    # The share of high angles counts in a dial alone.
    NAME: {"sac": (DIAL, EXPERT_NUMBERS), "iq-learn": (LONGER, LONGER_NUMBERS)},
}
"""Static config and hyperparameters by preset and learner."""
