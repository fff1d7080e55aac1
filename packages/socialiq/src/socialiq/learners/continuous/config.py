"""Configuration of the learners of continuous actions: static configs and hyperparameters."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any, Literal

from socialiq.errors import UserError
from socialiq.learners import config
from socialiq.learners.config import check_above_zero, check_counts, check_not_negative
from socialiq.learners.dial.config import check_high_share
from socialiq.learners.iq_learn import config as iq_learn
from socialiq.learners.iq_learn.config import Endings
from socialiq.social.angle import check_angle

CUT = Endings(timeout="bootstrap")
"""A time limit cuts an episode off: the usual reading where observations don't show the time."""


@dataclass(frozen=True)
class Shared:
    """Choices that all these learners have."""

    _: KW_ONLY
    hidden: tuple[int, ...] = (256, 256)
    """Widths of the hidden layers, of the actor and of each critic."""
    batch_size: int = 256
    """Transitions of an update: demonstrations, own ones, or as many of each."""
    updates: int = 20_000
    """Gradient steps of a run."""
    endings: Endings = CUT
    """Value of V(s') after each kind of ending."""
    dial: bool = False
    """Whether one network is trained for all angles from `low` to `high`: it then also reads
    (cos α, sin α), and each row of an update has an angle drawn for it."""
    low: float = 0.0
    """Smallest social angle of a dial, in degrees."""
    high: float = 90.0
    """Largest social angle of a dial, in degrees."""
    margin: float = 5.0
    """Degrees beyond both ends of a dial in which angles are also drawn."""
    high_from: float = 65.0
    """Angle in degrees from which `high_share` counts."""
    high_share: float | None = None
    """Share of a dial's drawn angles beyond `high_from`; None: uniform."""
    actions_per_state: int = 1
    """Actions that are drawn for the expectation over the policy in a state."""
    tuned: bool = False
    """Whether the temperature is tuned so that the policy has the entropy `entropy_target`; the
    given temperature is then the first."""
    times: int = 0
    """Number of values of the time, the last feature, which a view of vehicles reads one-hot: 0, 1,
    ..., times - 1. 0: observations don't show the time."""
    random_steps: int = 1000
    """First steps in the world with uniform actions."""
    updates_per_round: int = 500
    """Updates between two rounds of acting in a Gymnasium environment. Each round begins with a
    reset, so its steps should be several episodes long."""

    def check_shared(self, static: Any) -> None:
        """Refuse sizes and angles that make no run.

        Raises:
            UserError: If one is out of its range, or an option is of discrete actions.
        """
        check_counts(static, ("actions_per_state", "updates_per_round"))
        check_not_negative(static, ("random_steps", "margin", "times"))
        check_angle(static.low)
        check_angle(static.high)
        if static.low > static.high:
            raise UserError(
                f"angles from {static.low:g} to {static.high:g}: give the smaller first"
            )
        check_high_share(static)


@dataclass(frozen=True)
class StaticConfig(Shared, config.StaticConfig):
    """Choices that shape the program of soft actor-critic."""

    env_steps_per_update: int = 1
    """Steps the learner takes in the world before each gradient step."""
    replay_capacity: int = 100_000
    """Size of the replay ring."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        super().__post_init__()
        self.check_shared(self)
        check_counts(self, ("env_steps_per_update", "replay_capacity"))


@dataclass(frozen=True)
class OfflineStaticConfig(Shared, config.StaticConfig):
    """Choices that shape the program of TD3+BC."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        super().__post_init__()
        self.check_shared(self)
        if self.tuned:
            raise UserError("TD3+BC has no temperature to tune: leave it out")


@dataclass(frozen=True)
class CriticLoss:
    """Choice of the critics' loss in continuous IQ-Learn."""

    _: KW_ONLY
    critic: Literal["objective", "regression"] = "objective"
    """Loss of the critics: terms 1 to 3 of Eq 2.7, or the regression of r̂ to 4 α_χ on
    demonstrations and to -4 α_χ on own rows, which terms 1 to 3 are where own rows are drawn from
    the policy (Al-Hafez et al. 2023, LS-IQ); with `bounded` its targets are bounded."""


@dataclass(frozen=True)
class IQStaticConfig(Shared, CriticLoss, iq_learn.StaticConfig):
    """Choices that shape the program of continuous IQ-Learn."""

    replay_capacity: int = 100_000
    """Size of the replay ring."""
    target_kind: Any = "instantaneous"
    """Kind of "cumulative returns" in R(α), of `social.returns`, or the advantage."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and combinations that make no run."""
        super().__post_init__()
        self.check_shared(self)
        if self.form != "plain":
            raise UserError(f"form {self.form} is of discrete actions: use the form plain")
        if self.critic == "regression":
            self._check_regression()
        if self.dial and self.prior in ("none", "reweighting"):
            raise UserError(
                f"prior {self.prior} has no angle of a row: a dial needs reward, bellman_shift or "
                "shifted_chi2"
            )

    def _check_regression(self) -> None:
        derived = (self.prior, self.divergence, self.chi2_on) == ("none", "chi2", "mixture")
        if not (derived and self.online and self.value_term == "value"):
            raise UserError(
                "the regression of r̂ follows from the objective online, with prior none, "
                "divergence chi2, chi2 on the mixture and value term value: choose these"
            )


@dataclass(frozen=True)
class ActorRate:
    """Learning rate of the actor."""

    _: KW_ONLY
    actor_rate: float = 1.0
    """Learning rate of the actor, as a share of `learning_rate`, which critics and a tuned
    temperature have (Garg et al. 2021 take 0.1)."""


@dataclass(frozen=True)
class Tuning(ActorRate):
    """Numbers of a tuned temperature."""

    _: KW_ONLY
    entropy_target: float = -1.0
    """Entropy for each number of an action that a tuned temperature leads to; uniform actions have
    log 2 (Haarnoja et al. 2018 take -1)."""

    def check_tuning(self) -> None:
        """Refuse an actor's rate that is not positive, and an entropy that is not finite.

        Raises:
            UserError: If one is so.
        """
        check_above_zero(self, ("actor_rate",))
        if not math.isfinite(self.entropy_target):
            raise UserError(f"entropy_target must be a finite number, got {self.entropy_target}")


@dataclass(frozen=True)
class TowardsData(ActorRate):
    """Numbers of TD3+BC. Defaults: Fujimoto and Gu 2021."""

    _: KW_ONLY
    q_weight: float = 2.5
    """α of the paper: weight of Q, over its mean size, beside the squared distance of actions."""
    target_noise: float = 0.2
    """Deviation of the noise on the target policy's actions."""
    noise_clip: float = 0.5
    """Greatest size of that noise."""


@dataclass(frozen=True)
class Hyperparameters(Tuning, config.Hyperparameters):
    """Numbers of a run of soft actor-critic; all are traced."""

    temperature: float = 0.2
    """τ: weight of the entropy beside R(α), in units of reward."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        super().__post_init__()
        self.check_tuning()


@dataclass(frozen=True)
class IQHyperparameters(Tuning, iq_learn.Hyperparameters):
    """Numbers of a run of continuous IQ-Learn; all are traced."""

    temperature: float = 0.1
    """τ of V(s) = E_π[Q - τ log π]."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        super().__post_init__()
        self.check_tuning()


@dataclass(frozen=True)
class OfflineHyperparameters(TowardsData, config.Hyperparameters):
    """Numbers of a run of TD3+BC; all are traced."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        super().__post_init__()
        check_not_negative(self, ("q_weight", "target_noise"))
        check_above_zero(self, ("noise_clip", "actor_rate"))
