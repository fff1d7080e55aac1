"""Settings of the offline dial: config, hyperparameters, preset."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.settings import Count, Natural, Positive, Share


@dataclass(frozen=True, kw_only=True)
class OfflineDialConfig(settings.DrawnAngles, settings.LearnerConfig):
    """Choices that shape the program. Defaults: the intersection."""

    high_from: float = 77.0
    high_share: Share | None = 0.4
    """Share of the drawn angles beyond `high_from`, if the range reaches there; None: uniform. From
    there to 90 degrees policies change from driving to waiting."""
    members: Count = 1
    """Critics, trained on the same rows from different weights; their mean is used."""
    one_hot: tuple[tuple[int, int], ...] = ()
    """For observations of integers: smallest value and number of values of each feature, which the
    networks then see one place for each value. None: they see the view."""
    hidden: settings.Widths = (128, 128)
    view: settings.ViewName = "set"
    batch_size: Count = 256
    updates: Count = 5000
    """Gradient steps of the behaviour policy, and of the dial."""
    critic_factor: Count = 2
    """Gradient steps of the critics, over those of the other two."""
    whole_episode: Natural = 0
    """Decisions of a whole episode, where recordings end before it: a timeout before that many is
    the end of a view, behind which values go on. 0: every timeout ends an episode."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and ranges that make no run."""
        super().__post_init__()
        if (self.input_scale, self.schedule, self.averaging) != (1.0, "constant", 0.0):
            raise UserError(
                "the offline dial has a scale, a schedule and an average of its own: leave out "
                "input_scale, schedule and averaging"
            )

    @property
    def drawn(self) -> OfflineDialConfig:
        """Return this config, without a high share where the range doesn't reach beyond it."""
        reaches = self.low < self.high_from < self.high
        return self if reaches else dataclasses.replace(self, high_share=None)


@dataclass(frozen=True, kw_only=True)
class OfflineDialHyperparameters(settings.CosineRate):
    """Numbers of one run, all traced. The learning rate falls in each of the three stages."""

    temperature: Positive = 0.1
    """η from 30 to 60 degrees, in units of reward: the price of a nat of distance from the
    behaviour policy. Small values choose the best supported action, large ones clone."""
    end_temperature: Positive = 0.3
    """η up to 15 degrees and from 75 on; between, it changes with sin 2α. Where one reward decides
    alone, fewer demonstrators are overruled, and a critic's errors cost more."""
    discount: Share = 1.0
    """γ. The critics observe the time, so a finite horizon needs none."""
    learning_rate: Positive = 1e-3
    polyak: settings.Rate = 0.01
    dataset: Natural = 0
    """Number of the run among those trained together, each with data of its own; set by them."""


class OfflineDialPreset(NamedTuple):
    """One way to train an offline dial.

    Attributes:
        structure: Its structure; what the networks see of a gridworld is added.
        numbers: Its numbers; the seed is added.
    """

    structure: OfflineDialConfig
    numbers: OfflineDialHyperparameters


# Chosen on training seeds 100 and 101 (docs/reproduction/intersection-offline.md).
PRESETS = {
    "offline-regularised": OfflineDialPreset(OfflineDialConfig(), OfflineDialHyperparameters())
}
