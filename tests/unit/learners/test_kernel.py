"""Options of the kernel that every learner shares: averaging, schedule, input scale."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.behaviour_cloning import (
    BehaviourCloning,
    CloningConfig,
    CloningHyperparameters,
)
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.train import train
from socialiq.learners.state import TrainState, stack
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy

SMALL = CloningConfig(hidden=(8,), batch_size=8, updates=40)
RUN = CloningHyperparameters(learning_rate=0.01, seed=3)


def state_at(value: float, count: int) -> TrainState:
    """A network of one number after so many updates, with an average of 0."""
    state = TrainState.of({"w": jnp.zeros(())}, has_target=False, has_average=True)
    optimiser = state.optimiser._replace(count=jnp.asarray(count))
    return state._replace(network={"w": jnp.asarray(value)}, optimiser=optimiser)


@pytest.mark.parametrize(
    ("count", "expected"),
    [(1, 6.0), (2, 3.0), (3, 2.0), (100, 1.5)],  # 1/count until it falls below 1/4
)
def test_the_average_is_plain_and_then_forgets(count, expected):
    assert float(state_at(6.0, count).averaged(0.25).average["w"]) == pytest.approx(expected)


def test_a_policy_is_made_of_the_average(data):
    averaging = dataclasses.replace(SMALL, averaging=1.0)
    shared = BehaviourCloning.train_on(averaging, [RUN], [data])
    last = BehaviourCloning.train_on(SMALL, [RUN], [data])
    seen = data.observation[:5]
    # A share of 1 averages nothing; a small share gives another network.
    expected = last.policy(0).q_values(seen)
    np.testing.assert_array_equal(shared.policy(0).q_values(seen), expected)
    slow = BehaviourCloning.train_on(dataclasses.replace(SMALL, averaging=0.01), [RUN], [data])
    np.testing.assert_array_equal(slow.networks.layers[0].weight, last.networks.layers[0].weight)
    assert not np.allclose(slow.policy(0).q_values(seen), expected)
    averaged = network_of(slow.state.average, 0)
    expected = QPolicy.of(averaged, 1.0, {}).q_values(seen)
    np.testing.assert_array_equal(slow.policy(0).q_values(seen), expected)


def test_a_linear_schedule_ends_at_zero(data):
    learner = BehaviourCloning.of(dataclasses.replace(SMALL, schedule="linear"), [data])
    rates = [
        float(learner.learning_rate(stack([RUN])[0], jnp.asarray(done))) for done in (0, 10, 39)
    ]
    assert rates == pytest.approx([0.01, 0.0075, 0.00025], rel=1e-5)


def test_the_scale_of_the_inputs_becomes_part_of_the_policy(data):
    """A network of scale 3 on s is the same network of scale 1 on 3 s."""
    key = jax.random.key(0)
    scaled = QNetwork.initialise(key, 6, (8,), 3, "elu", scale=3.0)
    plain = QNetwork.initialise(key, 6, (8,), 3, "elu")
    seen = data.observation[:5]
    expected = jax.vmap(plain)(3.0 * seen)
    np.testing.assert_allclose(jax.vmap(scaled)(seen), expected, rtol=1e-6)
    np.testing.assert_allclose(QPolicy.of(scaled, 1.0, {}).q_values(seen), expected, rtol=2e-5)


def test_the_presets_for_few_demonstrations_train(data):
    static, numbers = presets.PRESETS["few-offline"]
    trained = train(dataclasses.replace(static, updates=20), [numbers], [data])
    assert trained.failures == ()
    assert trained.policy(0).provenance["structure"]["averaging"] == 0.001
