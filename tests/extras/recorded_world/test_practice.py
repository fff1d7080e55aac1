"""Practice of dials at a recorded junction."""

import numpy as np
import pytest

from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.types import Ending
from socialiq_recordings.world.practice import ANGLES, Practice, record, train_with_practice
from socialiq_recordings.world.replay import replay


class Braking:
    """Brakes always."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros(len(observation), np.int64), state


@pytest.fixture(scope="module")
def driven(made):
    return record(made.world, {"brakes": Braking()}, 60, 0.25, 5_000)


def test_a_share_of_decisions_is_drawn_at_random(made, driven):
    assert driven.n_episodes == 60 and driven.mode_names == ("brakes",)
    others = np.mean(driven.action != 0)
    expected = 0.25 * (1 - 1 / made.world.n_actions)
    assert others == pytest.approx(expected, abs=4 * np.sqrt(expected / len(driven.action)))
    assert driven.source["first_seed"] == 5_000


def test_episodes_are_whole_and_follow_from_their_seeds(made, driven):
    last = np.append(driven.episode_starts[1:], len(driven.action)) - 1
    assert np.all(np.asarray(driven.ending)[last] != int(Ending.NONE))
    again = record(made.world, {"brakes": Braking()}, 60, 0.25, 5_000)
    np.testing.assert_array_equal(again.action, driven.action)
    np.testing.assert_array_equal(again.observation, driven.observation)
    other = record(made.world, {"brakes": Braking()}, 60, 0.25, 6_000)
    assert not np.array_equal(other.episode_lengths, driven.episode_lengths)


def test_each_run_practises_on_its_own_and_learns_from_all_of_it(made):
    shown = replay(made.world, 1.0).table
    static = OfflineDialConfig(
        updates=2, hidden=(4,), batch_size=4, whole_episode=made.world.config.decisions
    )
    runs, told = [OfflineDialHyperparameters(seed=seed) for seed in (0, 1)], []

    def callbacks(number, stage):
        told.append((number, stage))
        return Callbacks()

    practice = Practice(2, episodes=3, first_seed=9_000)
    found = train_with_practice(made.world, static, runs, shown, practice, callbacks)
    assert [len(own) for own in found.driven] == [2, 2]
    assert all(one.n_episodes == 3 * ANGLES for own in found.driven for one in own)
    assert found.driven[0][1].mode_names[-1] == "practice 2 at 90"
    assert told == [(n, stage) for n in range(3) for stage in ("behaviour", "critics", "dial")]
    first, second = (own[0].observation for own in found.driven)
    assert not np.array_equal(first[:5], second[:5])
    alone = train_with_practice(made.world, static, runs, shown, Practice(0))
    assert alone.driven == [[], []]
    rows = len(shown.action) + sum(len(one.action) for one in found.driven[0])
    assert int(found.stages["dial"].learner.bounds[1]) == rows
