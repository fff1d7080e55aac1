"""Columns of episodes by name: what a world lacks is absent; blocks, rows, means and shares."""

import pickle

import numpy as np
import pytest
from tests.digest.junctions import made_junction
from tests.digest.rollouts import Always

from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.measures import DECISION, Episodes, joined, share, summary
from socialiq.statistics.intervals import normal_mean, wilson

EPISODES = Episodes(
    ending=np.array([1, 2, 2, 3, 2]), contact=np.array([0, 1, 2, 0, 0]), r_social=np.arange(5.0)
)


def test_a_quantity_that_a_world_lacks_has_no_column():
    world = made_junction()
    episodes = episodes_of(world.batch(4), Always(2), range(4), quantities=DECISION)
    assert "speed" in episodes and not {"off_road", "classical_own"} & episodes.keys()
    assert episodes.metrics().length == episodes.length.mean() > 0
    with pytest.raises(AttributeError, match="these episodes have no off_road"):
        _ = episodes.off_road


def test_a_collision_without_a_known_fault_is_the_egos():
    assert EPISODES.at_fault.tolist() == [False, True, False, False, True]
    assert EPISODES.struck.tolist() == [False, False, True, False, False]
    assert EPISODES["timeout"].tolist() == [False, False, False, True, False]


def test_blocks_and_rows_are_parts_of_the_table():
    again = joined([EPISODES.rows(slice(2)), EPISODES.rows([2, 3, 4])])
    assert again.keys() == EPISODES.keys() == pickle.loads(pickle.dumps(EPISODES)).keys()
    for name, column in EPISODES.items():
        np.testing.assert_array_equal(again[name], column)


def test_events_are_shares_and_numbers_are_means():
    row = summary(EPISODES, ("r_caused", "collision"))
    assert list(row)[:4] == ["r_caused", "r_caused_low", "r_caused_high", "collision"]
    assert row.items() >= normal_mean("r_caused", EPISODES.r_social).items()
    assert tuple(row[f"collision{end}"] for end in ("", "_low", "_high")) == wilson(3, 5)
    assert set(share("none", np.zeros(0, bool)).values()) == {None}
