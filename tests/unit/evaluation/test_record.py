"""Episodes as demonstrations: whole, in order, and with the sums that evaluation finds."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.play import episodes_of
from socialiq.evaluation.record import Recorded, record
from socialiq.types import Ending
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy

SEEDS = [5, 900, 17, 17, 3, 0, 88, 61]


def recorded(size: int = 3, name: str = "gap_3s") -> Recorded:
    return record(Batch(Options(), size), policy(name), SEEDS, "careful", {"policy": name})


@pytest.fixture(name="rows", scope="module")
def some_episodes() -> Recorded:
    return recorded()


def test_rows_of_an_episode_are_adjacent_and_counted(rows):
    table = rows.transitions
    assert table.n_episodes == len(SEEDS)
    assert (np.diff(table.episode) >= 0).all()
    lengths = np.bincount(table.episode)
    assert len({*lengths.tolist()}) > 1
    np.testing.assert_array_equal(table.step, np.concatenate([np.arange(n) for n in lengths]))


def test_what_is_seen_next_is_what_was_reached(rows):
    table = rows.transitions
    within = table.episode[1:] == table.episode[:-1]
    follows = (table.next_observation[:-1] == table.observation[1:]).all(axis=1)
    np.testing.assert_array_equal(follows, within)


def test_an_episode_begins_with_its_seed_and_is_over_at_its_last_row(rows):
    table = rows.transitions
    first = np.flatnonzero(table.step == 0)
    begin = Batch(Options(), len(SEEDS)).reset(SEEDS)
    np.testing.assert_array_equal(table.observation[first], begin)
    ended = np.append(table.step[1:] == 0, True)
    np.testing.assert_array_equal(table.ending != Ending.NONE, ended)
    np.testing.assert_array_equal(table.terminated | table.truncated, ended)
    np.testing.assert_array_equal(table.truncated, table.ending == Ending.TIMEOUT)


def test_actions_are_the_policys(rows):
    table = rows.transitions
    np.testing.assert_array_equal(table.action, policy("gap_3s").predict(table.observation)[0])
    assert len({*table.action.tolist()}) > 1


@pytest.mark.parametrize("name", ["gap_3s", "go", "wait"])
def test_sums_are_those_of_evaluation(name):
    made = recorded(name=name)
    table = made.transitions
    expected = episodes_of(Batch(Options(), 5), policy(name), SEEDS)

    def sums(column):
        return np.bincount(table.episode, column)

    np.testing.assert_array_equal(sums(table.rewards.env), expected.totals.env)
    np.testing.assert_array_equal(sums(table.rewards.social), expected.totals.social)
    np.testing.assert_array_equal(sums(made.classical.env), expected.classical.env)
    np.testing.assert_array_equal(sums(made.classical.social), expected.classical.social)
    np.testing.assert_array_equal(np.bincount(table.episode), expected.length)
    np.testing.assert_array_equal(table.ending[table.ending != 0], expected.ending)


@pytest.mark.parametrize("size", [1, 2, 8, 20])
def test_the_batchs_size_does_not_matter(size, rows):
    again = recorded(size)
    for name, column in rows.transitions.arrays().items():
        np.testing.assert_array_equal(again.transitions.arrays()[name], column, err_msg=name)
    for found, expected in zip(again.classical, rows.classical, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_the_table_says_who_drove_and_which_seeds(rows):
    table = rows.transitions
    assert table.mode_names == ("careful",) and not table.mode.any()
    assert table.source == {"first_seed": 0, "episodes": 8, "policy": "gap_3s"}
    assert table.n_actions == 3


def test_no_seeds_are_refused():
    with pytest.raises(UserError, match=r"^episodes must be at least 1, got 0$"):
        record(Batch(Options(), 2), policy("go"), [], "nobody")
