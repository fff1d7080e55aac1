import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.expert_table import ExpertTable
from socialiq.types import RewardPair
from studies.compare_methods.baselines.shared import Episodes, best_rows, preference_loss

SOCIAL = RewardPair(jnp.zeros(()), jnp.ones(()))


def test_levels_by_hand_with_a_tie_and_another_set(bandit) -> None:
    """Totals 5, 1, 3, 3, 0, 2 in three levels of two; the tie of 3 shares the better level."""
    first = bandit([0] * 6, [0.0] * 6, [5.0, 1.0, 3.0, 3.0, 0.0, 2.0])
    other = bandit([0] * 2, [0.0] * 2, [9.0, -9.0])
    table = ExpertTable.of([first, other], "instantaneous", 1.0)
    episodes = Episodes.of([first, other], table)
    levels = episodes.levels(SOCIAL, jnp.array(0), 3)
    np.testing.assert_array_equal(levels, [0, 2, 0, 0, 2, 1, 3, 3])
    np.testing.assert_array_equal(episodes.levels(SOCIAL, jnp.array(1), 2)[6:], [0, 1])


def test_the_best_rows_are_those_of_the_best_episodes(demonstrations) -> None:
    data = demonstrations(episodes=6)
    table = ExpertTable.of([data], "instantaneous", 1.0)
    episodes = Episodes.of([data], table)
    cumulative = best_rows(episodes, SOCIAL, jnp.array(0), 3)
    drawn = table.sample_weighted(jax.random.key(0), cumulative, 400).observation[:, 0]
    best = np.argsort(data.totals().social)[-2:]
    rows = np.flatnonzero(np.isin(data.episode, best))
    np.testing.assert_array_equal(np.unique(np.asarray(drawn)), rows)


def test_rows_of_episodes(demonstrations) -> None:
    data = demonstrations(episodes=3, length=4)
    shorter = data.select(np.array([1]))
    table = ExpertTable.of([data, shorter], "instantaneous", 1.0)
    episodes = Episodes.of([data, shorter], table)
    np.testing.assert_array_equal(episodes.rows[-1], [12, 13, 14, 15])
    assert episodes.inside.all() and int(episodes.of_row[16]) == 4
    np.testing.assert_allclose(episodes.totals.env[1], data.totals().env[1], rtol=1e-5)


def test_the_preference_loss_by_hand() -> None:
    """P(first) = 1 / (1 + e^-2); a pair of equal ranks is left out."""
    found = preference_loss(
        jnp.array([3.0, 0.0, 7.0]), jnp.array([1.0, 2.0, 0.0]), jnp.array([4.0, 0.5, 0.0])
    )
    expected = (np.log1p(np.exp(-2.0)) + np.log1p(np.exp(2.0))) / 3
    assert found == pytest.approx(expected, rel=1e-6)
