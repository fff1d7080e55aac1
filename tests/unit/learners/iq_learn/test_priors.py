from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.iq_learn import losses

REWARD, TARGET = jnp.array([1.0, 2.0]), jnp.array([2.0, -1.0])
EVERY = jnp.ones(4, bool)
SCORES = jnp.array([0.0, 1.0, 2.0, 2.0])


def test_social_prior_by_hand():
    """Eq 4.4 at λ = 0.5: the mean of (1 - 1)² and (2 + 0.5)²."""
    assert losses.social_prior(REWARD, TARGET, 0.5) == pytest.approx(3.125)


def test_gradient_of_the_social_prior_is_equation_4_6():
    """2 E[(r̂ - λR) ∂r̂/∂θ], for r̂ = tanh(θ·x)."""
    rng = np.random.default_rng(0)
    x, target, theta = rng.normal(size=(20, 3)), rng.normal(size=20), rng.normal(size=3)
    reward = np.tanh(x @ theta)
    slope = (1 - reward**2)[:, None] * x
    expected = 2 * ((reward - 0.7 * target)[:, None] * slope).mean(axis=0)
    found = jax.grad(lambda t: losses.social_prior(jnp.tanh(x @ t), jnp.asarray(target), 0.7))(
        jnp.asarray(theta)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_bellman_shift_by_hand():
    np.testing.assert_allclose(losses.bellman_shift(REWARD, TARGET, 0.5), [0.0, 2.5])


def test_shifted_chi2_by_hand():
    assert losses.shifted_chi2(REWARD, TARGET, 0.5, 0.5) == pytest.approx(1.5625)


def test_trimmed_priors_leave_the_largest_gaps_out():
    """(1 - 1)² of two squares at λ = 0.5; a forged label moves the plain prior, not this one."""
    assert losses.social_prior(REWARD, TARGET, 0.5, trimmed=0.5) == 0.0
    half = partial(losses.social_prior, trimmed=0.5)
    assert losses.shifted_chi2(REWARD, TARGET, 0.5, 0.5, half) == 0.0
    rewards = jnp.linspace(-1.0, 1.0, 8)
    forged = rewards.at[3].set(50.0)
    slope = jax.grad(lambda r: losses.social_prior(r, forged, 1.0, trimmed=0.2))(rewards)
    assert not slope.any() and losses.social_prior(rewards, forged, 1.0) > 100.0


def test_demonstration_weights_by_hand():
    """exp of (0, ln 2) at τ_w = 1 and (0, 2 ln 2) at τ_w = 0.5; the last is not allowed."""
    target, allowed = jnp.array([0.0, jnp.log(2.0), 50.0]), jnp.array([True, True, False])
    found = losses.demonstration_weights(target, allowed, 1.0)
    np.testing.assert_allclose(found, [1 / 3, 2 / 3, 0], rtol=1e-5)
    found = losses.demonstration_weights(target, allowed, 0.5)
    np.testing.assert_allclose(found, [1 / 5, 4 / 5, 0], rtol=1e-5)
    assert losses.effective_sample_size(jnp.array([1 / 3, 2 / 3, 0])) == pytest.approx(1.8)


def test_weights_sum_to_one_and_spread_less_as_the_temperature_falls():
    sizes = []
    for temperature in (100.0, 10.0, 1.0, 0.3, 0.1):
        weights = losses.demonstration_weights(SCORES, EVERY, temperature)
        assert weights.sum() == pytest.approx(1.0, rel=1e-6)
        sizes.append(float(losses.effective_sample_size(weights)))
    assert (np.diff(sizes) < 0).all()
    assert sizes[0] == pytest.approx(4.0, rel=1e-3)


def test_weights_at_the_limits_are_uniform_or_on_the_best_and_always_finite():
    hot = losses.demonstration_weights(1e4 * SCORES, EVERY, 1e12)
    np.testing.assert_allclose(hot, 0.25, rtol=1e-6)
    cold = losses.demonstration_weights(1e4 * SCORES, EVERY, 1e-4)
    np.testing.assert_allclose(cold, [0, 0, 0.5, 0.5])
    negative = losses.demonstration_weights(-1e4 * SCORES, EVERY, 1e-4)
    np.testing.assert_allclose(negative, [1, 0, 0, 0])
