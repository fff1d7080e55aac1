"""The one loop over seeded episodes: rows, seeds, and draws that belong to episodes."""

from typing import NamedTuple

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.simulate import SOFT, SoftActor, simulate
from socialiq.types import Ending, RewardPair
from socialiq.worlds.world import Actor, Simulator


class Made(NamedTuple):
    rewards: RewardPair
    ending: np.ndarray


class Countdown:
    """An episode of seed s lasts s steps; an action is paid as r_env."""

    def __init__(self, size):
        self.size, self.left = size, np.zeros(size, np.int64)
        self.begun = []

    def reset(self, seeds=None, rows=None):
        self.left[rows] = seeds
        self.begun += seeds.tolist()

    @property
    def observation(self):
        return self.left[:, None].astype(float)

    def seen_by(self, policy):
        return self.observation

    def step(self, action, auto_reset=False, rows=None):
        self.left[rows] -= 1
        ending = np.where(self.left == 0, int(Ending.ARRIVAL), int(Ending.NONE))
        return Made(RewardPair(action.astype(float), np.zeros(self.size)), ending)


class Coin:
    def probabilities(self, observations):
        return np.tile([0.25, 0.5, 0.25], (len(observations), 1))

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        raise AssertionError("a soft policy is asked for its probabilities")


LENGTHS = [3, 1, 5, 2, 2, 4, 1]


def actions_by_episode(size):
    simulator, found = Countdown(size), {number: [] for number in range(len(LENGTHS))}
    for step in simulate(simulator, SoftActor(Coin(), simulator), LENGTHS):
        for row in np.flatnonzero(step.running).tolist():
            found[int(step.episode[row])].append(int(step.action[row]))
    assert sorted(simulator.begun) == sorted(LENGTHS)
    return found


@pytest.mark.parametrize(("size", "block"), [(1, 64), (3, 64), (10, 64), (3, 1), (3, 2), (1, 3)])
def test_draws_belong_to_the_episode_whatever_the_rows_and_the_block(size, block, monkeypatch):
    monkeypatch.setattr("socialiq.evaluation.simulate.BLOCK", block)
    cumulative = np.array([0.25, 0.75, 1.0])
    for number, actions in actions_by_episode(size).items():
        length = LENGTHS[number]
        drawn = np.random.default_rng([SOFT, length]).random(length)
        assert actions == (drawn[:, None] >= cumulative).sum(axis=1).tolist()


def test_rows_are_refilled_until_the_seeds_run_out():
    simulator = Countdown(3)
    steps = list(simulate(simulator, SoftActor(Coin(), simulator), LENGTHS))
    assert sum(int(step.running.sum()) for step in steps) == sum(LENGTHS)
    assert all(step.running.all() for step in steps[:5])  # 18 decisions: never idle before the end
    assert {int(one) for step in steps for one in step.episode[step.running]} == set(range(7))


def test_it_needs_a_seed():
    with pytest.raises(UserError, match="at least 1"):
        next(simulate(Countdown(2), SoftActor(Coin(), Countdown(2)), []))


def test_the_protocols_are_those_of_the_back_ends():
    assert isinstance(Countdown(1), Simulator)
    assert isinstance(SoftActor(Coin(), Countdown(1)), Actor)
