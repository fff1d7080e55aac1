import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.continuous import actor_critic
from socialiq.nn.actor import Actor

SEEN = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def actor():
    return Actor.initialise(jax.random.key(0), 3, (8,), 2)


@pytest.fixture(scope="module")
def drawn(actor):
    return actor_critic.draw_actions(actor, jnp.asarray(SEEN), jax.random.key(1), 4)


def test_of_a_boltzmann_policy_every_draw_has_the_soft_value(drawn):
    """With π = exp(Q/τ) / Z each Q - τ log π is τ log Z: the actor is where it should be."""
    log_z = jnp.arange(5.0)
    q = 0.3 * (drawn.log_density + log_z)
    np.testing.assert_allclose(actor_critic.soft_value(q, drawn, 0.3), 0.3 * log_z, atol=1e-5)
    assert actor_critic.actor_loss(q, drawn, 0.3) == pytest.approx(-0.3 * 2.0, abs=1e-5)


def test_the_soft_value_of_any_other_policy_is_smaller(actor):
    """It is τ log Z less τ times a Kullback-Leibler divergence."""
    other = Actor.initialise(jax.random.key(5), 3, (8,), 2)
    many = actor_critic.draw_actions(actor, jnp.asarray(SEEN), jax.random.key(2), 4000)
    mean, log_std = jax.vmap(other)(jnp.asarray(SEEN))
    from socialiq.nn.actor import log_density

    rows = jax.vmap(jax.vmap(log_density), in_axes=(0, None, None))
    q = 0.5 * rows(many.action, mean, log_std)  # the other policy is Boltzmann's, log Z = 0
    assert bool((actor_critic.soft_value(q, many, 0.5) < 0.0).all())


def test_the_critics_have_half_the_squared_errors_of_both():
    q = jnp.array([[1.0, 2.0], [0.0, -1.0]])
    assert actor_critic.critic_loss(q, jnp.array([1.0, 1.0])) == pytest.approx((0 + 1 + 1 + 4) / 4)


@pytest.mark.parametrize(("entropy", "sign"), [(-10.0, 1.0), (10.0, -1.0)])
def test_the_temperature_falls_while_there_is_more_entropy_than_wanted(drawn, entropy, sign):
    slope = jax.grad(actor_critic.temperature_loss)(jnp.zeros(()), drawn, entropy)
    assert np.sign(float(slope)) == sign
