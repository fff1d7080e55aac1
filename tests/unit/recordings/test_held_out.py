import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.episodes.ego_swap import demonstrations
from socialiq_recordings.held_out import recordings_of, site_of, split


def test_whole_recordings_go_to_one_side(human_table):
    train, test = split(human_table, ["USA_Lanker-1_3_T-1"], "chain")
    assert recordings_of(train)[0] == ("USA_Lanker-1_1_T-1", "monday")
    assert recordings_of(test)[0] == ("USA_Lanker-1_3_T-1",)
    assert (train.n_episodes, test.n_episodes) == (4, 1)
    assert recordings_of(train)[1].tolist() == [0, 0, 1, 1]
    assert train.source["episode_identity"] == [100, 101, 100, 101]
    np.testing.assert_array_equal(test.rewards.env, [-2.0])
    np.testing.assert_array_equal(train.rewards.social[:3], [0.2, 0.0, -1.0])


def test_no_site_and_no_chain_is_on_both_sides(human, human_table):
    with pytest.raises(
        UserError, match="1_3_T-1 is held out and USA_Lanker-1_1_T-1 is not, but they show"
    ):
        split(human_table, ["USA_Lanker-1_3_T-1"])
    train, test = split(human_table, ["USA_Lanker-1_1_T-1", "USA_Lanker-1_3_T-1"])
    assert recordings_of(train)[0] == ("monday",) and test.n_episodes == 3
    human[2] = dataclasses.replace(human[2], chain=human[0].chain)
    for by in ("site", "chain"):
        with pytest.raises(UserError, match="have vehicles in common"):
            split(demonstrations(human), ["monday"], by)


def test_a_table_of_unknown_sites_is_not_split(human):
    unknown = [dataclasses.replace(one, site="", chain="") for one in human]
    with pytest.raises(UserError, match="lack the sites and chains"):
        split(demonstrations(unknown), ["monday"])


def test_one_recording_is_not_split(human):
    with pytest.raises(UserError, match="one can't be split"):
        split(demonstrations(human[:1]), [human[0].recording])


@pytest.mark.parametrize(
    ("held_out", "message"),
    [
        (["tuesday"], "no recording 'tuesday'"),
        ([], "both sides"),
        (["USA_Lanker-1_1_T-1", "USA_Lanker-1_3_T-1", "monday"], "both sides"),
    ],
)
def test_a_split_needs_two_sides(held_out, message, human_table):
    with pytest.raises(UserError, match=message):
        split(human_table, held_out)


def test_tables_that_lost_their_recordings_are_refused(human_table):
    with pytest.raises(UserError, match="picked or repeated"):
        split(human_table.select(np.array([0, 1])), ["monday"])
    with pytest.raises(UserError, match="lack the recording"):
        recordings_of(human_table.subsample(1))


@pytest.mark.parametrize(
    ("name", "site"),
    [
        ("USA_Lanker-1_13_T-1", "USA_Lanker-1"),
        ("C-USA_Lanker-1_13_T-1", "USA_Lanker-1"),
        ("DEU_Muc-12_1_T-1", "DEU_Muc-12"),
        ("07_tracks", "07_tracks"),
        ("simulated-3", "simulated-3"),
    ],
)
def test_scenarios_of_one_map_are_one_site(name, site):
    assert site_of(name) == site
