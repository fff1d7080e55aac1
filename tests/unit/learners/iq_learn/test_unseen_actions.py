"""Gradient of the objective for an action that only the learner takes, in a one-step world."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.objective import Batches, objective
from socialiq.learners.state import stack
from socialiq.nn.q_network import QNetwork
from socialiq.types import Ending, RewardPair

SHOWN, OWN = (3, 1, 0), (1, 1, 2)
"""Number of rows of demonstrations and of replay, by action of the only state."""

REWARD = (0.3, -0.2, 0.6)
NUMBERS = IQLearnHyperparameters(angle=0.0, strength=1.5, prior_weight=2.0, chi2_alpha=0.25)


def rows(counts: tuple[int, ...]) -> Batch:
    action = jnp.repeat(jnp.arange(3), jnp.array(counts))
    reward = jnp.array(REWARD)[action]
    state = jnp.ones((len(action), 1))
    ending = jnp.full(len(action), int(Ending.ARRIVAL))
    return Batch(state, action, state, ending, RewardPair(reward, jnp.zeros_like(reward)))


def gradient(q: np.ndarray, **choices: str) -> np.ndarray:
    """Return the derivative of the loss in Q(s, a)."""
    static = IQLearnConfig(batch_size=4, hidden=(), **choices)
    numbers = stack([NUMBERS])[0]
    network = QNetwork.initialise(jax.random.key(0), 1, (), 3)
    batches = Batches(expert=rows(SHOWN), replay=rows(OWN), initial=None)

    def loss(values: jax.Array) -> jax.Array:
        made = eqx.tree_at(
            lambda one: (one.layers[0].weight, one.layers[0].bias),
            network,
            (values[:, None], jnp.zeros(3)),
        )
        return objective(made, made, batches, numbers, static)[0]

    return np.asarray(jax.grad(loss)(jnp.asarray(q, jnp.float32)))


def policy(q: np.ndarray) -> np.ndarray:
    weight = np.exp(q / NUMBERS.temperature)
    return weight / weight.sum()


@pytest.mark.parametrize("level", [0.0, -5.0, -50.0])
def test_nothing_holds_an_action_that_only_the_learner_takes(level):
    """Its Q falls at the rate of its own probability, however low it is already."""
    q = np.array([0.4, 0.1, 0.2]) + level
    found = gradient(q, prior="reward", chi2_on="expert", target_kind="instantaneous")
    assert found[2] == pytest.approx(policy(q)[2], abs=1e-6) and found[2] > 0.2


def test_the_shifted_term_over_the_mixture_holds_it_near_its_reward():
    """-ρ_E + π + w (ρ_E + ρ) (r̂ - λR) / (4 α_χ), by action."""
    q = np.array([0.4, 0.1, -0.7])
    shown, own = np.array(SHOWN) / 4, np.array(OWN) / 4
    off = q - NUMBERS.strength * np.array(REWARD)
    pull = NUMBERS.prior_weight / (4 * NUMBERS.chi2_alpha)
    expected = -shown + policy(q) + pull * (shown + own) * off
    found = gradient(q, prior="shifted_chi2", chi2_on="mixture", target_kind="instantaneous")
    np.testing.assert_allclose(found, expected, atol=1e-5)
