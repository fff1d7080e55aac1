"""Q in two parts: value and log-probabilities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.iq_learn.losses import soft_value
from socialiq.nn.q_network import DuelingNetwork
from socialiq.nn.q_policy import QPolicy

TEMPERATURE = 0.3


@pytest.fixture(name="network", scope="module")
def drawn_network():
    return DuelingNetwork.initialise(jax.random.key(1), TEMPERATURE, 4, (8,), 3)


@pytest.fixture(name="observations", scope="module")
def random_observations():
    return np.random.default_rng(0).normal(size=(20, 4)).astype(np.float32)


def test_the_soft_value_and_the_soft_policy_are_its_parts(network, observations):
    q = jax.vmap(network)(jnp.asarray(observations))
    value = jax.vmap(network.value)(jnp.asarray(observations))[:, 0]
    logits = jax.vmap(network.logits)(jnp.asarray(observations))
    np.testing.assert_allclose(soft_value(q, TEMPERATURE), value, atol=1e-5)
    np.testing.assert_allclose(jax.nn.softmax(q / TEMPERATURE), jax.nn.softmax(logits), atol=1e-5)


def test_as_a_policy_it_differs_from_q_by_a_number_of_the_state(network, observations):
    policy = QPolicy.of(network, TEMPERATURE, {})
    gap = policy.q_values(observations) - np.asarray(jax.vmap(network)(jnp.asarray(observations)))
    np.testing.assert_allclose(gap, np.repeat(gap[:, :1], 3, axis=1), atol=1e-5)
    soft = jax.nn.softmax(jax.vmap(network.logits)(jnp.asarray(observations)))
    np.testing.assert_allclose(policy.probabilities(observations), soft, atol=1e-5)


def test_the_temperature_is_not_trained(network):
    gradient = jax.grad(lambda one: jnp.sum(one(jnp.ones(4)) ** 2))(network)
    assert float(gradient.temperature) == 0.0
    assert max(float(jnp.abs(leaf).max()) for leaf in jax.tree.leaves(gradient)) > 0.0
