"""Configuration of IQ-Learn: static config, which shapes the program, and hyperparameters.

Runs that share a structure and differ in numbers (angle, λ, w, seed, ...) train together in one
compiled program.
"""

from __future__ import annotations

import typing
from dataclasses import dataclass
from typing import Literal

from socialiq.errors import UserError, one_of
from socialiq.learners import settings
from socialiq.learners.settings import Count, NotNegative, Positive, Share
from socialiq.types import Ending

Treatment = Literal["zero", "bootstrap", "absorbing", "occupancy"]


@dataclass(frozen=True)
class Endings:
    """Value of V(s') in Eq 2.6 after each kind of ending.

    "zero"; "bootstrap": of the state reached, as if the episode went on; "absorbing": the entropy
    of a state that is never left; "occupancy": what the objective itself gives a state that is
    never left, by how often demonstrations and replay reach it (`losses.occupancy_value`).
    """

    arrival: Treatment = "zero"
    collision: Treatment = "zero"
    timeout: Treatment = "zero"
    """The thesis' single flag d makes a timeout terminal. "bootstrap" treats it as a cut."""
    other: Treatment = "zero"

    def __post_init__(self) -> None:
        """Refuse unknown treatments."""
        for kind, treatment in self.by_kind().items():
            what = f"treatment of {kind.name.lower()}"
            one_of(what, treatment, typing.get_args(Treatment))

    def by_kind(self) -> dict[Ending, str]:
        """The treatment of each kind that ends an episode."""
        return {kind: getattr(self, kind.name.lower()) for kind in Ending if kind != Ending.NONE}


@dataclass(frozen=True, kw_only=True)
class IQLearnConfig(settings.LearnerConfig, settings.Replay):
    """Choices that shape the program. Defaults: the thesis' 7x7 preset (Table C.1, gridworld)."""

    prior: Literal["none", "reward", "bellman_shift", "reweighting", "shifted_chi2"] = "reward"
    """Social prior: none (the baseline), Eq 4.4, B.1, B.2, or χ² centred on λR(α)."""
    target_kind: Literal[
        "running", "to_go", "trajectory", "instantaneous", "advantage", "advantage_fitted"
    ] = "running"
    """Kind of "cumulative returns" in R(α), of `social.returns`; or the advantage, by states
    that are seen again or by a fitted network (`social.advantage`)."""
    divergence: Literal["chi2", "kl", "reverse_kl", "hellinger", "js"] = "chi2"
    """The f-divergence of Eq 2.7."""
    value_term: Literal["value", "value_expert", "v0"] = "value"
    """Term 2 over demonstrations and replay, demonstrations only, or true initial states."""
    chi2_on: Literal["expert", "mixture"] = "expert"
    """Term 3 over demonstrations (Eq 2.7), or over demonstrations and replay."""
    next_value: Literal["target", "online"] = "target"
    """V(s') by a target network without gradient, or by the network itself with gradient."""
    bounded: bool = False
    """Whether V(s') is clipped to the values that rewards within `losses.reward_bound` can add up
    to (Al-Hafez et al. 2023)."""
    shift_term_3: bool = False
    """With prior "bellman_shift": whether term 3 sees the shifted reward too (see App. B.1)."""
    form: Literal["plain", "dueling"] = "plain"
    """Network of Q: plain, or dueling: V(s) and log π of networks of their own."""
    endings: Endings = Endings()
    """Value of V(s') after each kind of ending."""
    online: bool = True
    """Whether the learner acts in a world and keeps a replay; offline it sees only the data."""
    env_steps_per_update: Count = 1
    """Steps the learner takes in the world before each gradient step."""
    replay_capacity: Count = 10_000
    social_discount: Share = 0.99
    """γ_svo of the cumulative returns."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        super().__post_init__()
        if not self.online and self.value_term == "value":
            raise UserError(
                "value term 'value' needs the learner's own transitions: "
                "train online, or choose value_expert or v0"
            )
        if not self.online and self.chi2_on == "mixture":
            raise UserError("chi2 on the mixture needs replay: train online, or choose expert")
        derived = (self.prior, self.divergence, self.chi2_on) == ("none", "chi2", "mixture")
        if not derived and (self.bounded or "occupancy" in self.endings.by_kind().values()):
            raise UserError(
                "bounded values and the treatment occupancy follow from the objective with prior "
                "none, divergence chi2 and chi2 on the mixture: choose these three"
            )
        if self.prior == "shifted_chi2" and self.divergence != "chi2":
            raise UserError("prior shifted_chi2 needs divergence chi2")
        if (
            self.prior == "shifted_chi2"
            and self.chi2_on == "mixture"
            and self.target_kind != "instantaneous"
        ):
            raise UserError(
                "shifted_chi2 on the mixture needs target kind instantaneous: "
                "replay has rewards but no returns"
            )


@dataclass(frozen=True)
class IQLearnHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run; all are traced, so a whole grid of them shares one program.

    Defaults: Table C.1, gridworld column. λ scales the prior's target, not its weight.
    """

    prior_weight: NotNegative = 1.0
    """w: multiplies L_reg, or the shifted χ² term. The thesis has w = 1."""
    chi2_alpha: Positive = 0.5
    """α_χ of term 3."""
    reweight_temperature: Positive = 1.0
    """τ_w of Eq B.2."""
