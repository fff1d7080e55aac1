"""Configuration of the offline dial: static config, hyperparameters, preset."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

from socialiq.errors import UserError
from socialiq.learners import config
from socialiq.learners.config import (
    check_above_zero,
    check_counts,
    check_not_negative,
    check_rate,
    check_seed,
    check_shares,
)
from socialiq.social.angle import check_angle


@dataclass(frozen=True)
class StaticConfig(config.StaticConfig):
    """Choices that shape the program. Defaults: the intersection."""

    low: float = 0.0
    """Smallest social angle trained for, in degrees."""
    high: float = 90.0
    """Largest social angle trained for, in degrees."""
    margin: float = 5.0
    """Degrees beyond both ends in which angles are also drawn: a network is least accurate at the
    edge of its data."""
    high_from: float = 77.0
    """Angle in degrees from which `high_share` counts."""
    high_share: float | None = 0.4
    """Share of the drawn angles beyond `high_from`, if the range reaches there; None: uniform. From
    there to 90 degrees policies change from driving to waiting."""
    members: int = 1
    """Critics, trained on the same rows from different weights; their mean is used."""
    one_hot: tuple[tuple[int, int], ...] = ()
    """For observations of integers: smallest value and number of values of each feature, which the
    networks then see one place for each value. None: they see the view."""
    hidden: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of each network."""
    view: str = "set"
    """Encoding of the vehicles of the intersection; a name of `nn.view.CHOICES`."""
    batch_size: int = 256
    """Demonstrated transitions of an update."""
    updates: int = 5000
    """Gradient steps of the behaviour policy, and of the dial."""
    critic_factor: int = 2
    """Gradient steps of the critics, over those of the other two."""
    whole_episode: int = 0
    """Decisions of a whole episode, where recordings end before it: a timeout before that many is
    the end of a view, behind which values go on. 0: every timeout ends an episode."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and ranges that make no run."""
        super().__post_init__()
        check_angle(self.low)
        check_angle(self.high)
        if self.low > self.high:
            raise UserError(f"angles from {self.low:g} to {self.high:g}: give the smaller first")
        check_counts(self, ("members", "critic_factor"))
        check_not_negative(self, ("margin", "whole_episode"))
        if self.high_share is not None:
            check_shares(self, ("high_share",))
        if (self.input_scale, self.schedule, self.averaging) != (1.0, "constant", 0.0):
            raise UserError(
                "the offline dial has a scale, a schedule and an average of its own: leave out "
                "input_scale, schedule and averaging"
            )

    @property
    def drawn(self) -> StaticConfig:
        """Return this config, without a high share where the range doesn't reach beyond it."""
        reaches = self.low < self.high_from < self.high
        return self if reaches else dataclasses.replace(self, high_share=None)


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run, all traced."""

    temperature: float = 0.1
    """η from 30 to 60 degrees, in units of reward: the price of a nat of distance from the
    behaviour policy. Small values choose the best supported action, large ones clone."""
    end_temperature: float = 0.3
    """η up to 15 degrees and from 75 on; between, it changes with sin 2α. Where one reward decides
    alone, fewer demonstrators are overruled, and a critic's errors cost more."""
    discount: float = 1.0
    """γ. The critics observe the time, so a finite horizon needs none."""
    learning_rate: float = 1e-3
    """Adam's initial learning rate; it falls as a cosine in each stage."""
    final_rate: float = 0.02
    """Learning rate at the end of a stage, as a share of the first."""
    polyak: float = 0.01
    """Share of a network mixed into its running average at each update."""
    seed: int = 0
    """Seed of the networks and the sampling."""
    dataset: int = 0
    """Number of the run among those trained together, each with data of its own; set by them."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        check_not_negative(self, ("dataset",))
        check_above_zero(self, ("temperature", "end_temperature", "learning_rate"))
        check_rate(self, ("polyak",))
        check_shares(self, ("discount", "final_rate"))
        check_seed(self.seed)


class Preset(NamedTuple):
    """One way to train an offline dial.

    Attributes:
        structure: Its structure; what the networks see of a gridworld is added.
        numbers: Its numbers; the seed is added.
    """

    structure: StaticConfig
    numbers: Hyperparameters


# Chosen on training seeds 100 and 101 (docs/reproduction/intersection-offline.md).
PRESETS = {"offline-regularised": Preset(StaticConfig(), Hyperparameters())}
