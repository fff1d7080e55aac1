import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.objective import Batches, objective
from socialiq.learners.state import stack
from socialiq_lab.baselines import Pairs
from studies.compare_methods.baselines.offline import (
    SPRINQL,
    Graded,
    SPRINQLConfig,
    SPRINQLHyperparameters,
    SPRINQLNetworks,
    row_weights,
)


def graded(batch, level: list[int]) -> Graded:
    rows = batch._replace(
        observation=batch.observation[None, None].repeat(2, axis=0),
        action=batch.action[None, None].repeat(2, axis=0),
    )
    inside = jnp.ones(rows.action.shape, bool)
    return Graded(batch, jnp.array(level), Pairs(rows, inside, jnp.zeros(1)))


def test_one_level_without_a_reference_is_offline_iq_learn(constant, rows_of):
    """With λ = 0, β = 0 and a = 1 / (4 α_χ) the terms of Q are those of Eq 2.7 (value_expert)."""
    network, slow = constant(0.3, 1.1), constant(-0.4, 0.2)
    batch = rows_of([0, 1, 1], [1.0, 2.0, 3.0], ending=0)
    numbers = SPRINQLHyperparameters(90.0, 0.0, reference_weight=0.5, discount=0.9)
    run = stack([numbers])[0]
    own = SPRINQLNetworks(network, constant(0.7, 0.7))
    learner, steady = SPRINQL(SPRINQLConfig(), (1, 2)), SPRINQLNetworks(slow, own.reference)
    _, terms = learner.loss(own, steady, graded(batch, [0, 0, 0]), run)
    static = iq.IQLearnConfig(prior="none", online=False, value_term="value_expert", batch_size=3)
    same = stack([iq.IQLearnHyperparameters(chi2_alpha=0.5, discount=0.9)])[0]
    _, theirs = objective(network, slow, Batches(batch, None, None), same, static)
    for ours, name in (("expert", "expert"), ("value", "value"), ("distance", "chi2")):
        assert terms[ours] == pytest.approx(float(theirs[name]), rel=1e-5), name
    assert terms["reference"] == pytest.approx(0.0)


def test_a_level_has_the_share_of_its_reference_reward():
    """Means 0.8 and 0.2 over two rows and one: weights 0.4, 0.4 and 0.2."""
    found = row_weights(jnp.array([0.7, 0.9, 0.2]), jnp.array([0, 0, 1]), 3)
    np.testing.assert_allclose(found, [0.4, 0.4, 0.2], rtol=1e-6)


@pytest.mark.slow
def test_it_imitates_the_better_level(bandit):
    data = bandit([0, 1] * 15, [0.0] * 30, [0.0, 1.0] * 15)
    static = SPRINQLConfig(hidden=(8,), batch_size=16, updates=600, levels=2)
    numbers = [SPRINQLHyperparameters(90.0, learning_rate=0.01, conservatism=0.1)]
    trained = SPRINQL.train_on(static, numbers, [data])
    assert trained.failures == ()
    assert trained.policy(0).predict(data.observation[0])[0] == 1
