import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.objective import Batches, objective
from socialiq.learners.state import stack
from socialiq.nn.q_policy import QPolicy
from studies.compare_methods.baselines.offline import (
    IntentionConfig,
    IntentionHyperparameters,
    IntentionPolicy,
    MultiIntention,
)


def test_the_responsibilities_are_bayes_rule(constant, bandit):
    """Intentions take action 1 with chance 3/4 and 1/4; priors 1/2: the posterior is 3/4 or 1/4.

    With priors 0.9 and 0.1 it is 0.9 (3/4) / (0.9 (3/4) + 0.1 (1/4)) = 27/28.
    """
    data = bandit([1, 0], [0.0, 0.0], [1.0, 0.0])
    learner = MultiIntention.of(IntentionConfig(intentions=2), [data])
    networks = (constant(0.0, np.log(3.0)), constant(np.log(3.0), 0.0))
    run = stack([IntentionHyperparameters()])[0]
    even = jnp.full((2, 2), 0.5)
    np.testing.assert_allclose(
        learner.expectation(run, networks, even, 2), [[0.75, 0.25], [0.25, 0.75]], rtol=1e-5
    )
    uneven = jnp.array([[0.9, 0.1], [0.9, 0.1]])
    found = learner.expectation(run, networks, uneven, 2)
    np.testing.assert_allclose(found[0], [27 / 28, 1 / 28], rtol=1e-5)


def test_the_responsibilities_of_a_set_do_not_depend_on_the_others(constant, bandit):
    """A shorter set beside a longer one: rows beyond its end belong to no episode of it."""
    short = bandit([1, 0], [0.0, 0.0], [1.0, 0.0])
    long = bandit([0, 0, 1, 1, 1], [0.0] * 5, [1.0] * 5)
    networks = (constant(0.0, np.log(3.0)), constant(np.log(3.0), 0.0))
    static, run = IntentionConfig(intentions=2), stack([IntentionHyperparameters(dataset=0)])[0]
    alone = MultiIntention.of(static, [short]).expectation(run, networks, jnp.full((2, 2), 0.5), 2)
    both = MultiIntention.of(static, [short, long])
    beside = both.expectation(run, networks, jnp.full((7, 2), 0.5), 5)
    np.testing.assert_allclose(beside[:2], alone, rtol=1e-6)


def test_one_intention_is_offline_iq_learn(constant, rows_of):
    network, slow = constant(0.3, 1.1), constant(-0.4, 0.2)
    batch = rows_of([0, 1, 1], [1.0, 2.0, 3.0], ending=0)
    run = stack([IntentionHyperparameters(discount=0.9)])[0]
    learner = MultiIntention(IntentionConfig(intentions=1), (1, 2))
    found, _ = learner.loss((network,), (slow,), (batch, jnp.ones((3, 1))), run)
    static = iq.IQLearnConfig(prior="none", online=False, value_term="value_expert", batch_size=3)
    same = stack([iq.IQLearnHyperparameters(discount=0.9)])[0]
    theirs, _ = objective(network, slow, Batches(batch, None, None), same, static)
    assert found == pytest.approx(float(theirs), rel=1e-5)


@pytest.mark.parametrize(("angle", "best"), [(0.0, 2), (45.0, 1), (90.0, 1)])
def test_an_intention_without_episodes_is_never_the_best(constant, angle, best):
    """Its totals are -inf, and 0 times -inf is NaN, which `argmax` takes for the largest."""
    totals = np.array([[-np.inf, -np.inf], [1.0, 3.0], [2.0, 0.0]])
    policies = tuple(QPolicy.of(constant(0.0, value), 1.0, {}) for value in (1.0, 2.0, 3.0))
    assert IntentionPolicy(policies, totals).at(angle) is policies[best]


@pytest.mark.slow
def test_two_intentions_are_told_apart_without_labels(demonstrations):
    """Half of the episodes always take action 0, half action 1; each scores best at one angle."""
    import dataclasses

    data = demonstrations(episodes=12, n_actions=2)
    intent = data.episode % 2
    rewards = type(data.rewards)(1.0 - intent, intent * 1.0)
    data = dataclasses.replace(data, action=intent.astype(np.int32), rewards=rewards)
    static = IntentionConfig(intentions=2, hidden=(8,), batch_size=32, updates=600)
    numbers = [IntentionHyperparameters(learning_rate=0.01, temperature=0.1)]
    trained = MultiIntention.train_on(static, numbers, [data], chunk=50)
    assert trained.failures == ()
    policy = trained.policy(0)
    for angle, action in ((0.0, 0), (90.0, 1)):
        taken = policy.at(angle).predict(data.observation)[0]
        assert (taken == action).mean() > 0.9, angle
