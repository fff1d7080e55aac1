"""Every angle that a policy's record carries has an effect that taught it."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.continuous import train as continuous
from socialiq.learners.continuous.config import (
    ActorIQLearnConfig,
    ActorIQLearnHyperparameters,
    SACConfig,
    SACHyperparameters,
    TD3BCConfig,
    TD3BCHyperparameters,
)
from socialiq.learners.dial.config import PRESETS
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.iq_learn.config import (
    FEW_OFFLINE,
    IQLearnConfig,
    IQLearnHyperparameters,
)
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.learners.kernel import Learner
from socialiq.types import RewardPair

TINY: dict[str, Any] = {"hidden": (8,), "batch_size": 8, "updates": 4}
PRIORS = ("none", "reward", "bellman_shift", "reweighting", "shifted_chi2")


def without_social(data):
    zero = np.zeros_like(data.rewards.social)
    return dataclasses.replace(data, rewards=RewardPair(data.rewards.env, zero))


def trainings(demonstrations, drives, line):
    """Trainings by name: from hyperparameters to what `train` returns, and the numbers' class."""
    discrete, iq = demonstrations(), {"online": False, "value_term": "value_expert", **TINY}

    def of_iq(static, data=discrete):
        return lambda runs: train_iq(static, runs, [data]), IQLearnHyperparameters

    def cloned(kind, data, **settings):
        static = bc.CloningConfig(**TINY, **settings)
        return lambda runs: kind.train_on(static, runs, [data]), bc.CloningHyperparameters

    def acting(config, numbers, data=(), simulator=None, **settings):
        static = config(**TINY, **settings)
        return lambda runs: continuous.train(static, runs, data, simulator), numbers

    cql_static = cql.CQLConfig(**TINY)
    actor_iq = {"online": False, "value_term": "value_expert"}
    return {
        **{f"iq-learn {prior}": of_iq(IQLearnConfig(prior=prior, **iq)) for prior in PRIORS},
        "iq-learn few-offline": of_iq(dataclasses.replace(FEW_OFFLINE, **TINY)),
        "iq-learn without social rewards": of_iq(IQLearnConfig(**iq), without_social(discrete)),
        "cloning": cloned(bc.BehaviourCloning, discrete),
        "cloning weighted": cloned(bc.BehaviourCloning, discrete, weighted=True),
        "cql": (
            lambda runs: cql.ConservativeQ.train_on(cql_static, runs, [discrete]),
            cql.CQLHyperparameters,
        ),
        "actor cloning": cloned(bc.GaussianCloning, drives()),
        "actor cloning weighted": cloned(bc.GaussianCloning, drives(), weighted=True),
        **{
            f"actor iq-learn {prior}": acting(
                ActorIQLearnConfig, ActorIQLearnHyperparameters, [drives()], prior=prior, **actor_iq
            )
            for prior in PRIORS
        },
        "td3-bc": acting(TD3BCConfig, TD3BCHyperparameters, [drives()]),
        "td3-bc without social rewards": acting(
            TD3BCConfig, TD3BCHyperparameters, [without_social(drives())]
        ),
        "sac": acting(SACConfig, SACHyperparameters, (), line),
    }


UNLABELLED = {
    "iq-learn none",
    "iq-learn bellman_shift",
    "iq-learn few-offline",
    "iq-learn without social rewards",
    "cloning",
    "actor iq-learn none",
    "actor iq-learn bellman_shift",
    "actor cloning",
    "td3-bc without social rewards",
}
"""Trainings that no angle has an effect on, so that their policies carry none."""


QUICK = ("iq-learn reward", "iq-learn none", "cloning", "cloning weighted")


@pytest.mark.parametrize(
    "are_quick", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["some", "others"]
)
def test_a_label_of_an_angle_was_taught_by_the_angle(
    demonstrations, random_drives, line, are_quick
):
    for name, (train, numbers) in trainings(demonstrations, random_drives, line).items():
        if (name in QUICK) != are_quick:
            continue
        trained = train([numbers(angle=angle) for angle in (10.0, 60.0)])
        leaves = jax.tree.leaves(eqx.filter(trained.networks, eqx.is_array))
        equal = all(np.array_equal(*leaf) for leaf in leaves)
        records = [trained.policy(run).provenance["numbers"]["angle"] for run in range(2)]
        assert records == ([None, None] if name in UNLABELLED else [10.0, 60.0]), name
        assert not equal or name in UNLABELLED, name


class Deaf(Learner):
    """A learner that reads no angle."""

    def loss(self, network, _target, batch, _numbers, /):
        loss = bc.negative_log_likelihood(network, batch.observation, batch.action)
        return loss, {"loss": loss}


def test_two_angles_that_a_learner_of_ones_own_does_not_read_are_refused(demonstrations):
    runs = [Deaf.Hyperparameters(angle=angle) for angle in (0.0, 45.0)]
    static = Deaf.StaticConfig(**TINY)
    with pytest.raises(UserError, match="of 0 and 45 degrees are equal"):
        train_iq(static, runs, [demonstrations()], learner=Deaf)


def test_a_dial_of_data_without_social_rewards_is_refused(demonstrations, random_drives):
    data = without_social(demonstrations())
    with pytest.raises(UserError, match="no social rewards"):
        preset = PRESETS["offline"]
        train_dial(preset.structure, [preset.numbers], [data])
    with pytest.raises(UserError, match="no social rewards"):
        static = TD3BCConfig(**TINY, dial=True)
        continuous.train(static, [TD3BCHyperparameters()], [without_social(random_drives())])
