import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.learners.iq_learn.config import IQLearnHyperparameters
from socialiq.learners.state import stack
from socialiq.nn.q_network import network_of
from socialiq_lab.baselines import Pairs
from studies.compare_methods.baselines.online import (
    TREX,
    TREXConfig,
    TREXNetworks,
    TREXRows,
)


def test_the_loss_by_hand(constant, rows_of):
    """Learned rewards (1, -1); episodes of actions 0, 0 and 1: sums 2 and -1.

    One own row of action 0 with Q = 5, slow Q = (0, 0), γ = 0.5, τ = 1, λ = 2:
    the target is 2 + 0.5 ln 2.
    """
    network = TREXNetworks(constant(5.0, 0.0), constant(1.0, -1.0))
    slow = TREXNetworks(constant(0.0, 0.0), constant(9.0, 9.0))
    pairs = rows_of([0, 0, 1, 1], [0.0] * 4)
    pairs = pairs._replace(
        observation=pairs.observation.reshape(2, 1, 2, 1), action=pairs.action.reshape(2, 1, 2)
    )
    inside = jnp.array([[[True, True]], [[True, False]]])
    own = rows_of([0], [0.0], ending=0)
    drawn = TREXRows(own, Pairs(pairs, inside, jnp.array([-1.0])))
    learner = TREX(TREXConfig(), (1, 2))
    run = stack([IQLearnHyperparameters(strength=2.0, discount=0.5)])[0]
    _, terms = learner.loss(network, slow, drawn, run)
    assert terms["ranks"] == pytest.approx(np.log1p(np.exp(3.0)), rel=1e-5)
    assert terms["bellman"] == pytest.approx((5 - 2 - 0.5 * np.log(2)) ** 2 / 2, rel=1e-5)


@pytest.mark.slow
def test_the_learned_reward_ranks_the_demonstrators(table5):
    """In the 5x5 world at 0 degrees: GGGG, WGGGG, WWWWGGGG, the shorter the better."""
    data = trajectory_datasets(table5, [0], 1)
    static = TREXConfig(hidden=(16,), batch_size=8, updates=300, prior="none")
    numbers = [dataclasses.replace(IQLearnHyperparameters(), angle=0.0, learning_rate=0.01)]
    learner = dataclasses.replace(TREX.of(static, data), simulator=table5.world)
    trained = learner.train(numbers)
    assert trained.failures == ()
    network = network_of(trained.networks, 0)
    values = np.array([network.reward(row) for row in jnp.asarray(data[0].observation)])
    taken = values[np.arange(len(values)), data[0].action]
    sums = np.bincount(data[0].episode, taken)
    np.testing.assert_array_equal(np.argsort(sums), np.argsort(data[0].totals().env))
