"""Counts of a comparison, on two episodes of one decision that were changed by hand."""

import numpy as np
import pytest
from tests.page_core.equality import Replay, compared, native

from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy


@pytest.fixture(scope="module")
def replay():
    return native(Options(duration=2.0), np.arange(50_000_000, 50_000_003), policy("idle"))


def changed(replay, name, index, value, field=None):
    arrays = {key: array.copy() for key, array in replay.arrays.items()}
    target = arrays[name] if field is None else arrays[name][field]
    target[index] += value
    return Replay(replay.actions, arrays)


def test_a_replay_equals_itself(replay):
    found = compared(replay, replay, policy("idle"))
    assert found.episodes == found.same_endings == 3
    assert found.decisions == found.same_decisions == found.equal_rewards == 6
    assert found.observations == found.equal_observations == found.equal_states == 9
    assert found.largest == 0.0


def test_a_small_difference_is_close_and_not_equal(replay):
    found = compared(replay, changed(replay, "vehicles", (1, 0, 0), 1e-10, "x"))
    assert (found.equal_states, found.close_states) == (8, 9)
    assert found.largest == pytest.approx(1e-10, rel=1e-3)


def test_a_vehicle_that_is_not_there_does_not_count(replay):
    assert compared(replay, changed(replay, "vehicles", (1, 0, -1), 1.0, "x")).equal_states == 9


def test_another_lane_another_stream_and_another_ending_count(replay):
    assert compared(replay, changed(replay, "vehicles", (1, 0, 0), 1, "lane")).close_states == 8
    assert compared(replay, changed(replay, "episodes", (2, 1), 1, "state_low")).close_states == 8
    assert compared(replay, changed(replay, "ending", (2, 2), 1)).same_endings == 2


def test_rewards_and_observations_are_compared_by_step(replay):
    assert compared(replay, changed(replay, "rewards", (1, 2, 0), 1e-12)).equal_rewards == 5
    assert compared(replay, changed(replay, "rewards", (0, 2, 0), 1.0)).equal_rewards == 6
    seen = compared(replay, changed(replay, "observation", (0, 0, 0, 1), 0.5))
    assert seen.equal_observations == 8


def test_a_driver_is_asked_again_on_what_it_sees_there(replay):
    other = policy("go")
    assert compared(replay, replay, other).same_decisions == 0
