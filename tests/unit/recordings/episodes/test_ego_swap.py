"""From episodes to one table of demonstrations."""

import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.ego_swap import REASONS, check_distinct, demonstrations


def test_every_episode_keeps_its_recording_and_its_vehicle(human_table):
    assert human_table.counts() == {"human": (5, 11)}
    assert human_table.episode_lengths.tolist() == [2, 1, 1, 3, 4]
    assert human_table.source["episode_recording"] == [0, 0, 1, 2, 2]
    assert human_table.source["episode_identity"] == [100, 101, 100, 100, 101]
    assert human_table.source["residual_rms"] == pytest.approx(0.5)
    assert human_table.source["reading"]["policy_rate"] == 1


def test_out_of_view_is_a_truncation_and_nothing_else_is(human_table):
    last = np.append(human_table.episode_starts[1:], human_table.n_transitions) - 1
    kinds = [Ending.TIMEOUT, Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT, Ending.TIMEOUT]
    assert human_table.ending[last].tolist() == kinds
    assert human_table.truncated[last].tolist() == [True, False, False, True, True]
    assert human_table.terminated[last].tolist() == [False, True, True, False, False]


def test_next_observations_follow(human, human_table):
    np.testing.assert_array_equal(human_table.next_observation[0], human_table.observation[1])
    np.testing.assert_array_equal(
        human_table.next_observation[1], human[0].episodes[0].observation[2]
    )


def test_counts_say_what_became_of_everybody(human):
    row = human[0].counts
    assert (row["tracks"], row["episodes"], row["transitions"]) == (4, 2, 3)
    assert (row["arrivals"], row["collisions"], row["truncated"]) == (1, 0, 1)
    assert sum(row[reason] for reason in REASONS) == 2


def test_the_same_moments_under_two_names_are_refused(drive, swapped):
    one = swapped("a", [drive([[0.1, 0.1]])], {b"x", b"y", b"z"})
    with pytest.raises(UserError, match="a and b hold the same moments"):
        check_distinct([one, swapped("b", [drive([[0.1, 0.1]])], {b"x", b"y"})])
    check_distinct([one, swapped("b", [drive([[0.1, 0.1]])], {b"x", b"u", b"v"})])
    with pytest.raises(UserError, match="named 'a'"):
        check_distinct([one, swapped("a", [drive([[0.1, 0.1]])])])


def test_nobody_and_different_readings_are_refused(drive, swapped):
    with pytest.raises(UserError, match="no vehicle"):
        demonstrations([swapped("a", [])])
    other = swapped("b", [drive([[0.1, 0.1]])], config=EpisodeConfig(near=1.0))
    with pytest.raises(UserError, match="different choices"):
        demonstrations([swapped("a", [drive([[0.1, 0.1]])]), other])


@pytest.mark.parametrize(
    ("dt", "rate", "message"),
    [(0.1, 3, "divides 10"), (1 / 29.97, 1, "whole number"), (0.04, 2, "divides 25")],
)
def test_a_decision_needs_whole_frames(dt, rate, message):
    with pytest.raises(UserError, match=message):
        EpisodeConfig(policy_rate=rate).options_at(dt)


def test_the_recordings_rate_is_that_of_the_sub_steps():
    options = EpisodeConfig(policy_rate=5, target_speeds=(0.0, 7.0, 14.0)).options_at(0.04)
    assert (options.simulation_frequency, options.frames, options.max_speed) == (25, 5, 14.0)


def test_numbers_that_make_no_sense_are_refused():
    for given in ({"reach": float("inf")}, {"near": -1.0}, {"slack": float("nan")}):
        with pytest.raises(UserError):
            dataclasses.replace(EpisodeConfig(), **given)
