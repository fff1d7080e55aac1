import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.state import stack
from socialiq.types import RewardPair
from socialiq_lab.baselines import Episodes, Pairs, preference_loss
from studies.compare_methods.baselines.clones import (
    DiscriminatorWeighted,
    DWBCConfig,
    DWBCHyperparameters,
)

SOCIAL = RewardPair(jnp.zeros(()), jnp.ones(()))


def test_levels_by_hand_with_a_tie_and_another_set(bandit):
    """Totals 5, 1, 3, 3, 0, 2 in three levels of two; the tie of 3 shares the better level."""
    first = bandit([0] * 6, [0.0] * 6, [5.0, 1.0, 3.0, 3.0, 0.0, 2.0])
    other = bandit([0] * 2, [0.0] * 2, [9.0, -9.0])
    table = ExpertTable.of([first, other], "instantaneous", 1.0)
    episodes = Episodes.of([first, other], table)
    levels = episodes.levels(SOCIAL, jnp.array(0), 3)
    np.testing.assert_array_equal(levels, [0, 2, 0, 0, 2, 1, 3, 3])
    np.testing.assert_array_equal(episodes.levels(SOCIAL, jnp.array(1), 2)[6:], [0, 1])


def test_the_best_rows_are_those_of_the_best_episodes(demonstrations):
    data = demonstrations(episodes=6)
    learner = DiscriminatorWeighted.of(DWBCConfig(parts=3, batch_size=400), [data])
    run = stack([DWBCHyperparameters(90.0)])[0]
    (expert, _), _ = learner.draw(run, *learner.initialise(run))
    drawn = expert.observation[:, 0]
    best = np.argsort(data.totals().social)[-2:]
    rows = np.flatnonzero(np.isin(data.episode, best))
    np.testing.assert_array_equal(np.unique(np.asarray(drawn)), rows)


def test_rows_of_episodes(demonstrations):
    data = demonstrations(episodes=3, length=4)
    shorter = data.select(np.array([1]))
    table = ExpertTable.of([data, shorter], "instantaneous", 1.0)
    episodes = Episodes.of([data, shorter], table)
    np.testing.assert_array_equal(episodes.rows[-1], [12, 13, 14, 15])
    assert episodes.inside.all() and int(episodes.of_row[16]) == 4
    np.testing.assert_allclose(episodes.totals.env[1], data.totals().env[1], rtol=1e-5)


def test_the_preference_loss_by_hand(rows_of):
    """Learned sums 3 and 1, 0 and 2, 7 and 0; the third pair, of equal ranks, is left out.

    P(first) of the first pair is 1 / (1 + e^-2). The reward of action a is the observation times
    a, and the second step of each episode is no row of it.
    """
    sums, count = jnp.array([[3.0, 0.0, 7.0], [1.0, 2.0, 0.0]]), 12
    rows = rows_of([1] * count, [0.0] * count)
    observation = jnp.stack([sums, jnp.full((2, 3), 99.0)], axis=-1)[..., None]
    rows = rows._replace(observation=observation, action=rows.action.reshape(2, 3, 2))
    inside = jnp.array([True, False]) & jnp.ones((2, 3, 2), bool)
    pairs = Pairs(rows, inside, jnp.array([4.0, 0.5, 0.0]))
    found = preference_loss(lambda one: one[0] * jnp.arange(2.0), pairs)
    expected = (np.log1p(np.exp(-2.0)) + np.log1p(np.exp(2.0))) / 3
    assert found == pytest.approx(expected, rel=1e-6)
