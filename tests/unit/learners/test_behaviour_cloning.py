import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.behaviour_cloning import (
    BehaviourCloning,
    CloningConfig,
    CloningHyperparameters,
    effective_size,
    negative_log_likelihood,
)
from socialiq.nn.q_network import QNetwork
from socialiq.types import RewardPair

STATES = np.eye(3, dtype=np.float32)
COUNTS = np.array([[10, 0, 0], [5, 5, 0], [1, 3, 6]])


def counted(counts: np.ndarray) -> Demonstrations:
    """One transition of its own episode for each count of (state, action)."""
    state, action = (np.repeat(index.ravel(), counts.ravel()) for index in np.indices(counts.shape))
    rows = len(action)
    return Demonstrations(
        observation=STATES[state],
        action=action.astype(np.int32),
        next_observation=STATES[state],
        terminated=np.ones(rows, bool),
        truncated=np.zeros(rows, bool),
        ending=np.full(rows, 4, np.int8),
        rewards=RewardPair(np.zeros(rows), np.zeros(rows)),
        mode=np.zeros(rows, np.int8),
        episode=np.arange(rows, dtype=np.int32),
        step=np.zeros(rows, np.int32),
        mode_names=("counted",),
        n_actions=3,
        source={},
    )


def test_the_likelihood_by_hand():
    """Logits (0, ln 3) give the probabilities 1/4 and 3/4."""
    network = QNetwork.initialise(jax.random.key(0), 1, (), 2)
    weights, logits = jnp.zeros((2, 1)), jnp.array([0.0, jnp.log(3.0)])
    network = jax.tree.unflatten(jax.tree.structure(network), [weights, logits])
    found = negative_log_likelihood(network, jnp.ones((2, 1)), jnp.array([0, 1]))
    assert found == pytest.approx(-(np.log(1 / 4) + np.log(3 / 4)) / 2, rel=1e-6)


def test_clones_recover_the_frequencies_of_their_own_sets():
    sets, static = (
        [counted(COUNTS), counted(COUNTS[::-1])],
        CloningConfig(hidden=(), batch_size=256, updates=1500),
    )
    hyperparameters = [
        CloningHyperparameters(learning_rate=0.005, seed=seed, dataset=seed) for seed in (0, 1)
    ]
    cloned = BehaviourCloning.train_on(static, hyperparameters, sets, chunk=1500)
    expected = COUNTS / COUNTS.sum(axis=1, keepdims=True)
    for run, frequencies in ((0, expected), (1, expected[::-1])):
        np.testing.assert_allclose(cloned.policy(run).probabilities(STATES), frequencies, atol=0.05)
    record = cloned.policy(1).provenance
    assert (record["learner"], record["numbers"]["dataset"]) == ("behaviour_cloning", 1)


def two_episodes() -> Demonstrations:
    """Both of two steps: one takes action 0 and pays the ego 2, one takes 1 and pays others 2."""
    once = counted(np.array([[2, 2, 0], [0, 0, 0], [0, 0, 0]]))
    pays = np.array([1.0, 1.0, 0.0, 0.0])
    ends = np.array([False, True, False, True])
    return dataclasses.replace(
        once,
        terminated=ends,
        ending=np.where(ends, 4, 0).astype(np.int8),
        rewards=RewardPair(pays, pays[::-1].copy()),
        episode=np.array([0, 0, 1, 1], np.int32),
        step=np.array([0, 1, 0, 1], np.int32),
    )


def test_weighted_clones_follow_the_totals_of_episodes():
    """Totals 2 and 0: at τ_w = 2 / ln 3 the weights of the episodes are 3/4 and 1/4."""
    temperature = 2 / np.log(3)
    static = CloningConfig(hidden=(), batch_size=256, updates=1500, weighted=True)
    hyperparameters = [
        CloningHyperparameters(learning_rate=0.005, angle=0.0, reweight_temperature=temperature),
        CloningHyperparameters(learning_rate=0.005, angle=90.0, reweight_temperature=temperature),
        CloningHyperparameters(learning_rate=0.005, angle=90.0, reweight_temperature=1e6),
    ]
    cloned = BehaviourCloning.train_on(static, hyperparameters, [two_episodes()], chunk=1500)
    for run, first in enumerate([3 / 4, 1 / 4, 1 / 2]):
        chances = cloned.policy(run).probabilities(STATES[:1])[0]
        np.testing.assert_allclose(chances, [first, 1 - first, 0.0], atol=0.05)


def test_the_effective_size_by_hand():
    """Weights 3/8, 3/8, 1/8, 1/8: 1 / (2 * 9/64 + 2 / 64) = 3.2 of 4 transitions."""
    hyperparameters = CloningHyperparameters(reweight_temperature=2 / np.log(3))
    assert effective_size(two_episodes(), hyperparameters) == pytest.approx(3.2, rel=1e-5)
    hyperparameters = CloningHyperparameters(reweight_temperature=1e6)
    assert effective_size(two_episodes(), hyperparameters) == pytest.approx(4.0, rel=1e-5)


def test_weights_need_whole_episodes():
    with pytest.raises(UserError, match="misses steps"):
        BehaviourCloning.train_on(
            CloningConfig(weighted=True), [CloningHyperparameters()], [two_episodes().subsample(2)]
        )


def test_runs_without_demonstrations_are_refused():
    data = counted(COUNTS)
    for hyperparameters in ([], [CloningHyperparameters(dataset=1)]):
        with pytest.raises(UserError, match="the demonstrations that each run names"):
            BehaviourCloning.train_on(CloningConfig(), hyperparameters, [data])


@pytest.mark.usefixtures("as_a_user_runs_it")
@pytest.mark.parametrize(
    "make",
    [
        lambda: CloningConfig(activation="gelu"),
        lambda: CloningConfig(batch_size=0),
        lambda: CloningConfig(updates=0),
        lambda: CloningConfig(view="round"),
        lambda: CloningHyperparameters(angle=360.0),
        lambda: CloningHyperparameters(reweight_temperature=0.0),
        lambda: CloningHyperparameters(learning_rate=float("nan")),
        lambda: CloningHyperparameters(learning_rate=0.0),
        lambda: CloningHyperparameters(seed=2**32),
        lambda: CloningHyperparameters(dataset=-1),
    ],
)
def test_settings_that_make_no_run_are_refused(make):
    with pytest.raises(UserError) as caught:
        make()
    assert "\n" not in str(caught.value)
