import numpy as np
import pytest

from socialiq.learners import settings
from socialiq_lab.baselines import totals_of
from studies.compare_methods.baselines.clones import (
    OutcomeConditioned,
    OutcomeHyperparameters,
    scaling,
)


def test_it_asks_for_the_outcome_that_scores_best(bandit):
    """Action 0 comes to (1, 0) and action 1 to (0, 1): 0 degrees wants the first, 90 the second."""
    data = bandit([0, 1] * 10, [1.0, 0.0] * 10, [0.0, 1.0] * 10)
    static = settings.LearnerConfig(hidden=(16,), batch_size=16, updates=300)
    trained = OutcomeConditioned.train_on(
        static, [OutcomeHyperparameters(learning_rate=0.01)], [data]
    )
    policy = trained.policy(0)
    for angle, action in ((0.0, 0), (30.0, 0), (60.0, 1), (90.0, 1)):
        chances = policy.at(angle).probabilities(data.observation[:1])[0]
        assert chances[action] > 0.9, angle


def test_the_outcomes_are_the_episodes_totals(demonstrations):
    data = demonstrations()
    totals = np.stack(data.totals(), axis=1)
    np.testing.assert_allclose(totals_of(data), totals)
    mean, spread = scaling(totals)
    np.testing.assert_allclose(((totals - mean) / spread).std(axis=0), 1.0)
    np.testing.assert_allclose(scaling(np.ones((3, 2)))[1], 1.0)


def test_a_quantile_asks_for_a_lesser_outcome(bandit):
    data = bandit([0, 0, 1], [3.0, 2.0, 1.0], [0.0, 0.0, 0.0])
    static = settings.LearnerConfig(hidden=(), batch_size=4, updates=1)
    runs = [OutcomeHyperparameters(quantile=one) for one in (1.0, 0.0)]
    trained = OutcomeConditioned.train_on(static, runs, [data])
    best, worst = (trained.policy(run).at(0.0) for run in (0, 1))
    network = trained.policy(0).network.layers[0]
    mean, spread = scaling(totals_of(data))
    for policy, wanted in ((best, 3.0), (worst, 1.0)):
        weight = np.asarray(network.weight)[:, -2] if policy is best else None
        if weight is not None:
            shift = weight * (wanted - mean[0]) / spread[0]
            rest = np.asarray(network.weight)[:, -1] * (0.0 - mean[1]) / spread[1]
            np.testing.assert_allclose(policy.biases[0], network.bias + shift + rest, atol=1e-6)
    assert not np.allclose(best.biases[0], worst.biases[0])
    assert pytest.approx(mean[0]) == 2.0
