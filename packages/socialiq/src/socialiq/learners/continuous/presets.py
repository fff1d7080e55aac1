"""Settings for the intersection with continuous actions, as in the study `intersection-continuous`.

They were chosen there with acceleration alone (docs/reproduction/intersection-continuous.md).
"""

from __future__ import annotations

import dataclasses
from typing import Any

from socialiq.learners.continuous.config import (
    Hyperparameters,
    IQHyperparameters,
    IQStaticConfig,
    StaticConfig,
)
from socialiq.learners.iq_learn.config import Endings

STEPS_PER_UPDATE = 12
"""Environment steps for each update, of experts and dials with either kind of actions."""

_NETWORK: dict[str, Any] = {
    "view": "set",
    "hidden": (128, 128),
    "batch_size": 128,
    "endings": Endings(),
}

EXPERT = StaticConfig(
    **_NETWORK,
    times=20,
    updates=3_000,
    env_steps_per_update=STEPS_PER_UPDATE,
    updates_per_round=200,
    replay_capacity=40_000,
    schedule="linear",
)
"""Soft actor-critic on R(α), which sees the time."""

EXPERT_NUMBERS = Hyperparameters(temperature=0.03, learning_rate=2e-3, polyak=0.03, discount=0.99)
"""Of experts and dials."""

DIAL = dataclasses.replace(EXPERT, high_share=0.4)
"""The same, once it is made a dial, with the angles of the preset of discrete actions."""

LEARNER = IQStaticConfig(
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

LEARNER_NUMBERS = IQHyperparameters(temperature=0.1, learning_rate=3e-4, prior_weight=5.0)

LONGER = dataclasses.replace(LEARNER, updates=EXPERT.updates)
LONGER_NUMBERS = dataclasses.replace(LEARNER_NUMBERS, learning_rate=2e-3)
"""The same with as many updates as an expert, and its rate."""

NAME = "intersection-continuous"

PRESETS: dict[str, dict[str, tuple[Any, Any]]] = {
    # The share of high angles counts in a dial alone.
    NAME: {"sac": (DIAL, EXPERT_NUMBERS), "iq-learn": (LONGER, LONGER_NUMBERS)},
}
"""Static config and hyperparameters by preset and learner."""
