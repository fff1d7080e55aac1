import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.expert_table import ExpertTable

KEY = jax.random.key(0)


@pytest.fixture(name="sets", scope="module")
def two_sets(demonstrations):
    """Rows 0 to 39 in episodes of 8, and rows 0 to 14 in episodes of 5."""
    return [demonstrations(0), demonstrations(1, episodes=3, length=5)]


@pytest.fixture(name="table", scope="module")
def their_table(sets):
    return ExpertTable.of(sets, "to_go", 0.9)


def test_columns_are_the_sets_end_to_end(sets, table):
    assert table.row_bounds.tolist() == [0, 40, 55]
    assert table.start_bounds.tolist() == [0, 5, 8]
    assert table.starts[:8].tolist() == [0, 8, 16, 24, 32, 40, 45, 50]
    for name in ("observation", "action", "next_observation", "ending"):
        expected = np.concatenate([getattr(data, name) for data in sets])
        column = np.asarray(getattr(table.columns, name))
        np.testing.assert_array_equal(column[:55], expected)
        assert len(column) == 2048 and not column[55:].any()


def test_targets_are_the_returns_of_the_chosen_reading(sets, table):
    for rows, data in ((slice(0, 40), sets[0]), (slice(40, 55), sets[1])):
        found, expected = table.columns.target, data.returns("to_go", 0.9)
        np.testing.assert_allclose(found.env[rows], expected.env, rtol=1e-5)
        np.testing.assert_allclose(found.social[rows], expected.social, rtol=1e-5)


@pytest.mark.parametrize(("dataset", "rows"), [(0, range(40)), (1, range(15))])
def test_sampling_reaches_all_rows_of_its_set_and_no_other(table, dataset, rows):
    batch = table.sample(KEY, jnp.int32(dataset), 3000)
    assert set(batch.observation[:, 0].tolist()) == set(rows)
    first = int(table.row_bounds[dataset])
    drawn = first + batch.observation[:, 0].astype(int)
    np.testing.assert_array_equal(batch.action, table.columns.action[drawn])
    np.testing.assert_array_equal(batch.target.social, table.columns.target.social[drawn])


@pytest.mark.parametrize(("dataset", "firsts"), [(0, {0, 8, 16, 24, 32}), (1, {0, 5, 10})])
def test_initial_states_are_the_first_rows_of_the_set(table, dataset, firsts):
    states = table.sample_initial(KEY, jnp.int32(dataset), 200)
    assert set(states[:, 0].tolist()) == firsts


def test_weighted_sampling_has_the_frequencies_of_the_weights(table):
    weights = np.zeros(55)
    weights[[3, 10, 20]] = 0.2, 0.5, 0.3
    batch = table.sample_weighted(KEY, jnp.asarray(weights.cumsum(), jnp.float32), 20_000)
    frequencies = np.bincount(batch.observation[:, 0].astype(int), minlength=55)[:55] / 20_000
    assert set(np.flatnonzero(frequencies)) == {3, 10, 20}
    np.testing.assert_allclose(frequencies, weights, atol=0.012)


def test_rounding_of_the_cumulative_weights_never_draws_a_row_of_weight_zero(table):
    """A float32 sum of weights ends near 1, not at it; here far from it, to make it sure."""
    weights = np.zeros(55)
    weights[[3, 10]] = 0.5, 0.3
    batch = table.sample_weighted(KEY, jnp.asarray(weights.cumsum(), jnp.float32), 2000)
    assert set(batch.observation[:, 0].tolist()) == {3.0, 10.0}


def test_draws_on_the_very_bounds_take_a_row_with_weight(table, monkeypatch):
    weights = np.zeros(55)
    weights[[3, 10]] = 0.5
    monkeypatch.setattr(jax.random, "uniform", lambda key, shape: jnp.array([0.0, 0.5]))
    batch = table.sample_weighted(KEY, jnp.asarray(weights.cumsum(), jnp.float32), 2)
    assert batch.observation[:, 0].tolist() == [3.0, 10.0]


def test_sets_that_cannot_stand_together_are_refused(demonstrations):
    with pytest.raises(UserError, match="no demonstrations"):
        ExpertTable.of([], "to_go", 0.9)
    with pytest.raises(UserError, match="different observations"):
        ExpertTable.of([demonstrations(), demonstrations(n_features=4)], "to_go", 0.9)
    with pytest.raises(UserError, match="different actions"):
        ExpertTable.of([demonstrations(), demonstrations(n_actions=4)], "to_go", 0.9)
    with pytest.raises(UserError, match="unknown target kind"):
        ExpertTable.of([demonstrations()], "future", 0.9)
