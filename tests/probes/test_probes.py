"""Worlds so small that the trained policy is known in advance; failures locate the error.

In the style of Andy Jones' probe environments: each adds one possible source of error.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import expit

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners import cql
from socialiq.learners.iq_learn.config import Endings, IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.train import train
from socialiq.learners.kernel import Trained
from socialiq.types import Ending, RewardPair

TABULAR = IQLearnConfig(
    online=False,
    value_term="value_expert",
    target_kind="instantaneous",
    hidden=(),
    batch_size=128,
    updates=6000,
)
ONLY_STATE = np.ones((1, 1), np.float32)


def table(
    rows: Sequence[tuple[int, int, int, Ending, float, float]], n_states: int, n_actions: int
) -> Demonstrations:
    """Demonstrations of rows (s, a, s', ending, r_env, r_social), states one-hot."""
    state, action, after, ending, env, social = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    states = np.eye(n_states, dtype=np.float32)
    ended = ending != Ending.NONE
    return Demonstrations.of(
        observation=states[state],
        action=action,
        next_observation=states[after],
        ending=ending,
        rewards=RewardPair(env, social),
        episode=np.concatenate([[0], np.cumsum(ended)[:-1]]),
        n_actions=n_actions,
    )


def bandit(counts: tuple[int, int]) -> Demonstrations:
    """One state; action 0 gives the pair (1, 0), action 1 gives (0, 1)."""
    egoist, altruist = (0, 0, 0, Ending.OTHER, 1.0, 0.0), (0, 1, 0, Ending.OTHER, 0.0, 1.0)
    return table([egoist] * counts[0] + [altruist] * counts[1], 1, 2)


def solve(
    static: IQLearnConfig,
    hyperparameters: Sequence[IQLearnHyperparameters],
    datasets: Sequence[Demonstrations],
) -> Trained:
    trained = train(static, hyperparameters, datasets, chunk=static.updates)
    assert trained.failures == ()
    return trained


ALIKE, EQUAL, UNEQUAL = range(3)
COUNTS = [(0, 10), (10, 10), (7, 3)]
RATE = 6e-4
BANDITS = {
    "alike": IQLearnHyperparameters(0.0, prior_weight=0.0, learning_rate=0.01, dataset=ALIKE),
    "egoist": IQLearnHyperparameters(0.0, 3.0, learning_rate=RATE, dataset=EQUAL),
    "altruist": IQLearnHyperparameters(90.0, 3.0, learning_rate=RATE, dataset=EQUAL),
    "between": IQLearnHyperparameters(45.0, 3.0, learning_rate=RATE, dataset=EQUAL),
    "baseline": IQLearnHyperparameters(prior_weight=0.0, learning_rate=RATE, dataset=EQUAL),
    "unequal": IQLearnHyperparameters(prior_weight=0.0, learning_rate=RATE, dataset=UNEQUAL),
    "as in the thesis": IQLearnHyperparameters(90.0, 1.0, 1.0, learning_rate=RATE, dataset=UNEQUAL),
    "strong": IQLearnHyperparameters(
        45.0, 2.0, 0.5, temperature=0.3, learning_rate=RATE, dataset=UNEQUAL
    ),
    "against": IQLearnHyperparameters(
        180.0, 0.5, chi2_alpha=0.25, temperature=2.0, learning_rate=RATE, dataset=UNEQUAL
    ),
    "strength zero": IQLearnHyperparameters(90.0, 0.0, learning_rate=RATE, dataset=UNEQUAL),
}


@pytest.fixture(name="bandits", scope="module")
def trained_bandits():
    return solve(TABULAR, list(BANDITS.values()), [bandit(counts) for counts in COUNTS])


def chance_of_0(trained: Trained, name: str) -> float:
    policy = trained.policy(list(BANDITS).index(name))
    return float(policy.probabilities(ONLY_STATE)[0, 0])


def test_what_every_demonstrator_does_is_imitated(bandits):
    assert chance_of_0(bandits, "alike") < 0.1


def test_the_angle_decides_between_equally_frequent_modes(bandits):
    assert chance_of_0(bandits, "egoist") > 0.7
    assert chance_of_0(bandits, "altruist") < 0.3
    assert chance_of_0(bandits, "between") == pytest.approx(0.5, abs=0.02)


def test_without_a_prior_equally_frequent_modes_stay_equal(bandits):
    assert chance_of_0(bandits, "baseline") == pytest.approx(0.5, abs=0.02)
    assert 0.5 < chance_of_0(bandits, "unequal") < 0.7  # the entropy draws 0.7 towards 0.5


def minimiser(share: float, hyperparameters: IQLearnHyperparameters) -> np.ndarray:
    """Q of the stationary point of L_total where every transition ends its episode.

    Then r̂ = Q and term 2 is V, and dL/dQ_a = 0 reads
    Q_a = (1 - π_a / p_a + 2 w λ R_a) / (2 (c + w)): theory's Theorem 1. π = softmax(Q/τ) leaves
    one equation for π_0.
    """
    radians = np.deg2rad(hyperparameters.angle)
    score, p = np.array([np.cos(radians), np.sin(radians)]), np.array([share, 1 - share])
    kappa = 1 / (4 * hyperparameters.chi2_alpha) + hyperparameters.prior_weight
    pull = 2 * hyperparameters.prior_weight * hyperparameters.strength * score

    def q(chance: float) -> np.ndarray:
        return (1 - np.array([chance, 1 - chance]) / p + pull) / (2 * kappa)

    def gap(chance: float) -> float:
        return chance - expit((q(chance)[0] - q(chance)[1]) / hyperparameters.temperature)

    return q(brentq(gap, 0.0, 1.0))


@pytest.mark.parametrize("name", [name for name in BANDITS if name != "alike"])
def test_long_training_reaches_the_minimiser_in_closed_form(bandits, name):
    hyperparameters = BANDITS[name]
    egoist, altruist = COUNTS[hyperparameters.dataset]
    q = bandits.policy(list(BANDITS).index(name)).q_values(ONLY_STATE)[0]
    expected = minimiser(egoist / (egoist + altruist), hyperparameters)
    np.testing.assert_allclose(q, expected, atol=1e-2)


@pytest.mark.parametrize(
    ("choices", "worth"),
    [
        ({"next_value": "target"}, 2.0),
        pytest.param(
            {"next_value": "online", "endings": Endings(timeout="bootstrap")},
            4.0,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_values_travel_back_at_the_discount(choices, worth):
    """One action only: V = Q and term 1 cancels term 2, so r̂ is the centre w λ R / (c + w) = 2.

    A road of two steps is worth γ 2 at its start. A state that repeats and pays each time is
    worth 2, or 2 / (1 - γ) where its timeouts are cuts.
    """
    road = [(0, 0, 1, Ending.NONE, 0.0, 0.0), (1, 0, 1, Ending.ARRIVAL, 3.0, 0.0)]
    loop = [(0, 0, 0, Ending.TIMEOUT, 3.0, 0.0)]
    shared: dict[str, Any] = {"learning_rate": 3e-3, "polyak": 0.1}
    hyperparameters = [
        IQLearnHyperparameters(discount=0.9, **shared),
        IQLearnHyperparameters(discount=0.5, **shared),
        IQLearnHyperparameters(discount=0.5, dataset=1, **shared),
    ]
    static = dataclasses.replace(TABULAR, updates=3000, **choices)
    found = solve(static, hyperparameters, [table(rows * 4, 2, 1) for rows in (road, loop)])
    far, near, repeating = (found.policy(run).q_values(np.eye(2))[:, 0] for run in range(3))
    np.testing.assert_allclose(far, [1.8, 2.0], atol=0.02)
    np.testing.assert_allclose(near, [1.0, 2.0], atol=0.02)
    assert repeating[0] == pytest.approx(worth, abs=0.02)


CONSERVATIVE = cql.CQLConfig(hidden=(), batch_size=128, updates=6000)


def test_conservative_q_learning_reaches_its_minimiser_in_closed_form():
    """If every transition ends: p_a (Q_a - λ R_a) + α_CQL (π_a - p_a) = 0."""
    settings = [
        cql.CQLHyperparameters(0.0, 2.0, 0.5, learning_rate=RATE),
        cql.CQLHyperparameters(90.0, 1.0, 1.0, temperature=0.5, learning_rate=RATE),
        cql.CQLHyperparameters(45.0, 3.0, 0.0, learning_rate=RATE),
    ]
    found = cql.ConservativeQ.train_on(
        CONSERVATIVE, settings, [bandit((7, 3))], chunk=CONSERVATIVE.updates
    )
    assert found.failures == ()
    share = np.array([0.7, 0.3])
    for run, hyperparameters in enumerate(settings):
        radians = np.deg2rad(hyperparameters.angle)
        reward = hyperparameters.strength * np.array([np.cos(radians), np.sin(radians)])
        policy = found.policy(run)
        chance = policy.probabilities(ONLY_STATE)[0]
        expected = reward + hyperparameters.conservatism * (1 - chance / share)
        np.testing.assert_allclose(
            policy.q_values(ONLY_STATE)[0], expected, atol=0.05
        )  # of Adam on batches


@pytest.mark.slow
def test_conservative_values_travel_back_at_the_discount():
    """With a single action the conservative term is 0, and Q is the discounted reward."""
    road = [(0, 0, 1, Ending.NONE, 0.0, 0.0), (1, 0, 1, Ending.ARRIVAL, 3.0, 0.0)]
    hyperparameters = cql.CQLHyperparameters(discount=0.9, learning_rate=3e-3, polyak=0.1)
    found = cql.ConservativeQ.train_on(
        CONSERVATIVE, [hyperparameters], [table(road * 4, 2, 1)], chunk=6000
    )
    np.testing.assert_allclose(found.policy(0).q_values(np.eye(2))[:, 0], [2.7, 3.0], atol=0.02)
