import jax
import jax.numpy as jnp
import numpy as np
import pytest

from studies.compare_methods.baselines.clones import (
    DiscriminatorWeighted,
    DWBCConfig,
    DWBCHyperparameters,
    discriminator_loss,
)


def test_the_discriminator_estimates_the_ratio_of_densities():
    """Half of the others' rows are of the first kind, 3/4 of the expert's: d = η p_E / p_O.

    With η = 0.5 the loss has no slope at 0.5 (3/4) / (1/2) = 3/4 and at 0.5 (1/4) / (1/2) = 1/4.
    """
    expert, others = jnp.array([0, 0, 0, 1]), jnp.array([0, 0, 1, 1])

    def loss(logits: jax.Array) -> jax.Array:
        return discriminator_loss(logits[expert], logits[others], 0.5)

    best = jnp.log(jnp.array([0.75 / 0.25, 0.25 / 0.75]))
    np.testing.assert_allclose(jax.grad(loss)(best), 0.0, atol=1e-6)
    assert jnp.abs(jax.grad(loss)(best + 0.5)).max() > 0.01


@pytest.mark.slow
def test_it_clones_the_best_part(bandit):
    data = bandit([0, 0, 1] * 10, [0.0] * 30, [0.0, 0.0, 1.0] * 10)
    static = DWBCConfig(hidden=(8,), batch_size=16, updates=400)
    numbers = [DWBCHyperparameters(90.0, learning_rate=0.01)]
    trained = DiscriminatorWeighted.train_on(static, numbers, [data])
    assert trained.failures == ()
    assert trained.policy(0).probabilities(data.observation[:1])[0, 1] > 0.7
