import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.nn import actor

CASES = [(0.0, 0.0), (0.7, -1.0), (-1.5, 0.5), (0.2, -2.5)]


@pytest.mark.parametrize(("mean", "log_std"), CASES)
def test_the_density_integrates_to_one(mean, log_std):
    u = np.linspace(-12.0, 12.0, 60_001, dtype=np.float32)[:, None]
    given = jnp.full(1, mean), jnp.full(1, log_std)
    logs = np.asarray(jax.vmap(lambda one: actor.log_density_before(one, *given))(u))
    action = np.tanh(u[:, 0].astype(np.float64))
    assert np.trapezoid(np.exp(logs), action) == pytest.approx(1.0, abs=2e-4)


def test_of_two_numbers_it_is_the_product():
    mean, log_std = jnp.array([0.3, -0.2]), jnp.array([-0.5, 0.1])
    action = jnp.array([0.4, -0.9])
    apart = [
        actor.log_density(action[i : i + 1], mean[i : i + 1], log_std[i : i + 1]) for i in range(2)
    ]
    together = actor.log_density(action, mean, log_std)
    assert together == pytest.approx(float(sum(apart)), rel=1e-5)


def test_a_drawn_action_has_the_density_that_comes_with_it():
    mean, log_std, noise = jnp.array([0.3]), jnp.array([-0.7]), jnp.array([0.8])
    action, log_density = actor.draw(noise, mean, log_std)
    assert log_density == pytest.approx(float(actor.log_density(action, mean, log_std)), rel=1e-4)


def test_far_from_zero_the_slope_of_tanh_keeps_its_digits():
    u = jnp.array([30.0, -30.0])
    np.testing.assert_allclose(actor.squash_log_slope(u), np.log(4.0) - 60.0, rtol=1e-6)


def test_actions_at_the_bounds_have_a_finite_density():
    ends = jnp.array([1.0, -1.0])
    found = actor.log_density(ends, jnp.zeros(2), jnp.zeros(2))
    assert np.isfinite(float(found))
