"""IQ-Learn with value and log-probabilities of networks of their own."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.train import IQLearn, train
from socialiq.learners.state import stack

STATIC = IQLearnConfig(
    form="dueling",
    prior="none",
    online=False,
    value_term="value_expert",
    hidden=(8,),
    batch_size=16,
    updates=20,
)
NUMBERS = IQLearnHyperparameters(temperature=0.2)


def test_offline_it_is_cloning_and_half_the_square_of_the_reward(data):
    """V - Q = -τ log π, and γ V(s') of terms 1 and 2 cancels: τ x likelihood + E[r̂²]/(4 α_χ)."""
    learner = IQLearn.of(STATIC, [data])
    run = stack([NUMBERS])[0]
    state, carry = learner.initialise(run)
    batches, _ = learner.draw(run, state, carry)
    loss, terms = jax.jit(lambda *of_run: learner.loss(*of_run))(
        state.network, state.target_network, batches, run
    )
    rows = batches.expert
    log_policy = jax.nn.log_softmax(jax.vmap(state.network.logits)(rows.observation))
    likelihood = -jnp.mean(jnp.take_along_axis(log_policy, rows.action[:, None], axis=1))
    expected = NUMBERS.temperature * likelihood + terms["chi2"]
    assert float(loss) == pytest.approx(float(expected), rel=1e-4)


def test_its_policy_is_cloned_with_weights_linear_in_the_advantage(data):
    """The gradient for log π is that of -τ E[(1 + 2 c δ) log π], δ = γ V(s') - V(s) - τ log π."""
    learner = IQLearn.of(STATIC, [data])
    run = stack([NUMBERS])[0]
    state, carry = learner.initialise(run)
    batches, _ = learner.draw(run, state, carry)
    rows, tau = batches.expert, NUMBERS.temperature

    def log_policy(logits):
        found = jax.nn.log_softmax(jax.vmap(logits)(rows.observation))
        return jnp.take_along_axis(found, rows.action[:, None], axis=1)[:, 0]

    network = state.network
    follows = jax.vmap(network.value)(rows.next_observation)[:, 0] * (rows.ending == 0)
    value = jax.vmap(network.value)(rows.observation)[:, 0]
    error = NUMBERS.discount * follows - value - tau * log_policy(network.logits)
    weight = 1.0 + 2.0 / (4.0 * NUMBERS.chi2_alpha) * error

    def cloned(logits):
        return -tau * jnp.mean(weight * log_policy(logits))

    def loss(one):
        return learner.loss(one, state.target_network, batches, run)[0]

    expected, whole = jax.jit(jax.grad(cloned))(network.logits), jax.jit(jax.grad(loss))(network)
    for one, other in zip(jax.tree.leaves(whole.logits), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_a_run_is_saved_as_a_plain_policy(data, tmp_path):
    runs = [dataclasses.replace(NUMBERS, temperature=one) for one in (0.2, 1.0)]
    trained = train(STATIC, runs, [data])
    assert trained.failures == ()
    for number, one in enumerate(runs):
        policy = trained.policy(number)
        policy.save(tmp_path / f"{number}.safetensors")
        assert policy.temperature == one.temperature
        logits = jax.tree.map(lambda leaf, n=number: leaf[n], trained.networks.logits)
        soft = jax.nn.softmax(jax.vmap(logits)(jnp.asarray(data.observation)))
        np.testing.assert_allclose(policy.probabilities(data.observation), soft, atol=1e-5)
