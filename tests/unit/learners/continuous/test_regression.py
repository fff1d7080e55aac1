"""The regression of r̂ (LS-IQ) beside the objective that it follows from."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.continuous.config import ActorIQLearnConfig, ActorIQLearnHyperparameters
from socialiq.learners.continuous.iq_learn import regression_terms
from socialiq.learners.continuous.train import train
from socialiq.learners.iq_learn import losses

STATIC = ActorIQLearnConfig(
    hidden=(8,),
    batch_size=8,
    updates=20,
    random_steps=5,
    replay_capacity=50,
    prior="none",
    chi2_on="mixture",
    bounded=True,
    critic="regression",
)
ALPHA = 0.3


def test_it_is_terms_1_to_3_but_for_a_constant():
    """With E_own[V - γ V'] = E_own[r̂], Eq 2.7 has the same value up to -4 α_χ."""
    shown, own = (jax.random.normal(jax.random.key(seed), (32,)) for seed in (0, 1))
    regression = sum(regression_terms(shown, own, ALPHA).values())
    chi2 = losses.chi2_term(jnp.concatenate([shown, own]), ALPHA)
    objective = losses.expert_term("chi2", shown) + jnp.mean(own) + chi2
    np.testing.assert_allclose(regression - objective, 4.0 * ALPHA, rtol=1e-5)


def test_its_minimum_is_the_contrast_of_occupancies():
    """Of a reward by action alone: 4 α_χ (d_E - d) / (d_E + d), which `reward_bound` bounds."""
    shown, own = np.array([0] * 6 + [1] * 2), np.array([0] * 1 + [1] * 4 + [2] * 3)
    counts = [np.bincount(rows, minlength=3) for rows in (shown, own)]
    wanted = 4.0 * ALPHA * (counts[0] - counts[1]) / (counts[0] + counts[1])

    def loss(reward):
        return sum(regression_terms(reward[shown], reward[own], ALPHA).values())

    np.testing.assert_allclose(jax.grad(loss)(jnp.array(wanted)), 0.0, atol=1e-6)
    assert np.abs(jax.grad(loss)(jnp.zeros(3))).max() > 0.1
    assert wanted.min() == pytest.approx(-float(losses.reward_bound(ALPHA)))


@pytest.mark.slow
def test_it_trains_with_bounded_values(line, drives):
    numbers = ActorIQLearnHyperparameters(chi2_alpha=0.01, discount=0.5)
    trained = train(STATIC, [numbers], [drives], simulator=line, chunk=10)
    assert trained.failures == ()
    assert {"expert", "own"} <= set(trained.history.values)
    assert not {"chi2", "value"} & set(trained.history.values)


@pytest.mark.parametrize(
    "change",
    [
        {"prior": "reward", "bounded": False},
        {"chi2_on": "expert", "bounded": False},
        {"value_term": "v0"},
        {"divergence": "js", "bounded": False},
    ],
)
def test_other_objectives_have_no_such_regression(change):
    line = "the regression of r̂ follows from the objective with --world, --prior none"
    with pytest.raises(UserError, match=re.escape(line)):
        dataclasses.replace(STATIC, **change)
