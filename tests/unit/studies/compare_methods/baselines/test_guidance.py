import jax
import numpy as np
import pytest
from scipy.special import softmax

from socialiq.learners.state import stack
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from studies.compare_methods.baselines.clones import (
    GuidanceConfig,
    GuidanceHyperparameters,
    GuidedCloning,
    guided,
)


@pytest.mark.parametrize("hidden", [(), (5,), (5, 4)])
def test_the_guided_network_is_the_product_policy(hidden):
    """π_w ∝ π̂ (π̂_1 / π̂)^w, for networks of any depth."""
    observation = np.random.default_rng(0).normal(size=(7, 3)).astype(np.float32)
    plain, optimal = (
        QPolicy.of(QNetwork.initialise(jax.random.key(seed), 3, hidden, 4), 1.0, {})
        for seed in (0, 1)
    )
    a, b = plain.probabilities(observation), optimal.probabilities(observation)
    for weight in (0.0, 1.0, 3.0):
        product = a * (b / a) ** weight
        np.testing.assert_allclose(
            guided(plain, optimal, weight).probabilities(observation),
            product / product.sum(axis=1, keepdims=True),
            atol=1e-6,
        )


def test_actions_no_worse_than_the_mean_are_optimal(bandit):
    """Of rewards 0 and 1 in one state the mean is 1/2, so o = 1 where the reward is 1."""
    data = bandit([0, 1] * 10, [0.0] * 20, [0.0, 1.0] * 10)
    learner = GuidedCloning.of(GuidanceConfig(batch_size=64), [data])
    run = stack([GuidanceHyperparameters(90.0, dropped=0.25)])[0]
    state, carry = learner.initialise(run)
    drawn, _ = learner.draw(run, state, carry)
    rows, condition = drawn
    shown = np.asarray(condition.env) > 0
    optimal = np.asarray(condition.social)
    assert 0.5 < shown.mean() < 0.95
    np.testing.assert_array_equal(optimal[shown], rows.action[shown])
    assert not optimal[~shown].any()


@pytest.mark.slow
def test_more_guidance_is_a_better_policy(bandit):
    """1 of 4 demonstrations is good, so p(a = 1 | o = 1) = 1 and guidance finds it."""
    data = bandit([0, 0, 0, 1] * 10, [0.0] * 40, [0.0, 0.0, 0.0, 1.0] * 10)
    runs = [
        GuidanceHyperparameters(90.0, guidance=one, learning_rate=0.01) for one in (0.0, 0.5, 1.0)
    ]
    static = GuidanceConfig(hidden=(8,), batch_size=32, updates=400)
    trained = GuidedCloning.train_on(static, runs, [data])
    good = [trained.policy(run).probabilities(data.observation[:1])[0, 1] for run in range(3)]
    assert good[0] == pytest.approx(0.25, abs=0.08)
    assert good[0] < good[1] < good[2] and good[2] > 0.9
    assert softmax(trained.policy(2).q_values(data.observation[:1]))[0, 1] > 0.9
