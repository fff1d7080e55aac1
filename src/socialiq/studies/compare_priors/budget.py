"""One budget for every row of the comparison: each learner's settings, from IQ-Learn's.

`base` gives network, batches, updates and steps in the world, `rates` the rates and discounts.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.dial import config as dial
from socialiq.learners.dqn import config as dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.studies.compare_priors.methods import Method


class Run(NamedTuple):
    """One training run: angle in degrees, λ (or 1/τ_w), seed, and the number of its data set."""

    angle: float
    strength: float
    seed: int
    dataset: int


def structure_of(method: Method, base: iq.StaticConfig) -> iq.StaticConfig:
    """IQ-Learn's structure for a method."""
    changes: dict[str, Any] = {"prior": method.prior, "target_kind": method.target_kind}
    return dataclasses.replace(base, **changes, shift_term_3=method.shift_term_3)


def numbers_of(base: iq.Hyperparameters, run: Run) -> iq.Hyperparameters:
    """IQ-Learn's numbers for a lane; what multiplies R(α) is its strength, also in Eq B.2."""
    return dataclasses.replace(
        base,
        angle=run.angle,
        strength=run.strength,
        reweight_temperature=1 / run.strength,
        seed=run.seed,
        dataset=run.dataset,
    )


def clone_structure(base: iq.StaticConfig, weighted: bool) -> bc.StaticConfig:
    """A clone's structure; weighted ones lean on rows of high R(α)."""
    return bc.StaticConfig(
        base.hidden, base.activation, base.batch_size, base.updates, weighted, base.view
    )


def clone_numbers(rates: iq.Hyperparameters, run: Run) -> bc.Hyperparameters:
    """A clone's numbers for a lane."""
    return bc.Hyperparameters(
        rates.learning_rate, run.seed, run.dataset, run.angle, 1 / run.strength
    )


def cql_structure(base: iq.StaticConfig) -> cql.StaticConfig:
    """Conservative Q-learning's structure."""
    return cql.StaticConfig(
        base.endings, base.hidden, base.activation, base.view, base.batch_size, base.updates
    )


def cql_numbers(rates: iq.Hyperparameters, run: Run) -> cql.Hyperparameters:
    """Conservative Q-learning's numbers for a lane."""
    return cql.Hyperparameters(
        angle=run.angle,
        strength=run.strength,
        temperature=rates.temperature,
        discount=rates.discount,
        learning_rate=rates.learning_rate,
        polyak=rates.polyak,
        seed=run.seed,
        dataset=run.dataset,
    )


def rl_structure(base: iq.StaticConfig) -> dqn.StaticConfig:
    """Deep Q-learning with the updates and steps in the world of the other rows."""
    return dqn.StaticConfig(
        base.view,
        base.hidden,
        base.activation,
        batch_size=base.batch_size,
        steps=base.updates * base.env_steps_per_update,
        steps_per_update=base.env_steps_per_update,
        replay_capacity=base.replay_capacity,
    )


def rl_numbers(rates: iq.Hyperparameters, run: Run) -> dqn.Hyperparameters:
    """Deep Q-learning's numbers for a lane."""
    return dqn.Hyperparameters(
        angle=run.angle,
        discount=rates.discount,
        learning_rate=rates.learning_rate,
        final_learning_rate=rates.learning_rate,
        polyak=rates.polyak,
        seed=run.seed,
    )


def dial_structure(base: iq.StaticConfig) -> dial.StaticConfig:
    """The dial's structure at the others' budget."""
    return dial.StaticConfig(
        endings=base.endings,
        hidden=base.hidden,
        activation=base.activation,
        view=base.view,
        expert_batch=base.batch_size,
        replay_batch=base.batch_size,
        updates=base.updates,
        environments=base.env_steps_per_update,
        replay_capacity=base.replay_capacity,
    )


def dial_numbers(rates: iq.Hyperparameters, run: Run) -> dial.Hyperparameters:
    """The dial's numbers for a lane, with the others' rates; the angle is asked for later."""
    return dial.Hyperparameters(
        strength=run.strength,
        temperature=rates.temperature,
        discount=rates.discount,
        learning_rate=rates.learning_rate,
        final_rate=1.0,
        polyak=rates.polyak,
        seed=run.seed,
        dataset=run.dataset,
    )
