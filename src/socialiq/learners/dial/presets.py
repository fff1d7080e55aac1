"""Settings of the 7x7 world's dials, by name."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from socialiq.learners.dial.config import Hyperparameters, StaticConfig


class Preset(NamedTuple):
    """One way to train a dial.

    Attributes:
        structure: Its structure; what the network sees of the world is added.
        numbers: Its numbers; the seed is added.
        clock: Whether the world shows the time.
        support: Which actions an offline learner can know: at the time at which they were
            demonstrated ("timed"), or at any ("any time"); empty online.
    """

    structure: StaticConfig
    numbers: Hyperparameters
    clock: bool = True
    support: str = ""


_ONLINE = StaticConfig(redraw_times=25, replay_batch=448)
_OFFLINE = StaticConfig(online=False, scored="demonstrations")
# Chosen on training seeds 0 to 4 (docs/dial.md).
RUNS = {
    "online": Preset(_ONLINE, Hyperparameters()),
    "online-alone": Preset(
        dataclasses.replace(_ONLINE, demonstrations=False, replay_batch=512), Hyperparameters()
    ),
    "online-clockless": Preset(
        dataclasses.replace(_ONLINE, redraw_times=0), Hyperparameters(discount=0.99), clock=False
    ),
    "offline": Preset(
        dataclasses.replace(_OFFLINE, updates=12_000),
        Hyperparameters(prior_weight=50.0, temperature=0.03),
        support="timed",
    ),
    "offline-redrawn": Preset(
        dataclasses.replace(_OFFLINE, updates=16_000, redraw_times=25),
        Hyperparameters(prior_weight=200.0),
        support="any time",
    ),
}


# Chosen on training seeds 0 to 4; what it costs and what it reaches: docs/benchmarks.md.
QUICK = Preset(
    dataclasses.replace(_ONLINE, hidden=(64, 64), expert_batch=8, replay_batch=120, updates=6000),
    Hyperparameters(learning_rate=6e-3, polyak=0.05),
)


PRESETS = RUNS | {"online-quick": QUICK}
"""The study's runs, and one that takes less than twice the time of a run of the thesis' learner."""
