import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.train import Budget, train, weighed
from socialiq.learners.state import stack

OFFLINE = DialConfig(
    online=False, scored="demonstrations", hidden=(8,), expert_batch=4, updates=2000
)


def test_a_multiplier_weighs_the_score_and_keeps_the_entropy():
    hyperparameters = stack([DialHyperparameters(prior_weight=4.0, temperature=0.5)])
    found = weighed(hyperparameters, jnp.array([2.0]))
    assert found.prior_weight.tolist() == [8.0]
    assert found.temperature.tolist() == [0.25]
    before = hyperparameters.prior_weight * hyperparameters.temperature
    np.testing.assert_allclose(found.prior_weight * found.temperature, before)


def test_the_multiplier_finds_the_budget(demonstrations):
    """A regret of 1/μ: budgets of 0.5 and 0.1 are met at μ = 2 and μ = 10."""
    budget = Budget(lambda _network, _run, mu: 1.0 / mu, np.array([0.5, 0.1]), step=0.5)
    runs = [DialHyperparameters(seed=0), DialHyperparameters(seed=1)]
    trained = train(OFFLINE, runs, [demonstrations()], chunk=50, budget=budget)
    np.testing.assert_allclose(trained.retained, [2.0, 10.0], rtol=0.02)
    assert [look.updates for look in budget.path] == list(range(50, 2000, 50))
    np.testing.assert_allclose(trained.history.array("multiplier")[-1], trained.retained)
    assert trained.policy(1).turned.temperature == pytest.approx(0.02 / trained.retained[1])


def test_a_budget_out_of_reach_stops_at_the_largest_multiplier(demonstrations):
    budget = Budget(lambda *_: 1.0, np.array([0.1]), step=1.0, high=5.0)
    static = dataclasses.replace(OFFLINE, updates=500)
    trained = train(static, [DialHyperparameters()], [demonstrations()], chunk=50, budget=budget)
    assert trained.retained.tolist() == [5.0]


def test_without_a_budget_the_multiplier_is_one(demonstrations):
    static = dataclasses.replace(OFFLINE, updates=20)
    assert train(
        static, [DialHyperparameters()], [demonstrations()], chunk=20
    ).retained.tolist() == [1.0]


def test_budgets_that_mean_nothing_are_refused():
    with pytest.raises(UserError, match="must be above 0"):
        Budget(lambda *_: 0.0, np.array([0.0]))
    with pytest.raises(UserError, match="give 0 < low < high"):
        Budget(lambda *_: 0.0, np.array([1.0]), low=2.0, high=1.0)
