"""Environments whose actions are arrays: in [-1, 1], scaled by their own bounds."""

import re

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.evaluation.rollout import rollout_env
from socialiq.types import RewardPair
from socialiq.worlds.environment import action_size, make_environment, sizes
from socialiq.worlds.wrapper import RewardPairWrapper, UnitActions, check_spaces


class Slope(gymnasium.Env):
    """Pays its action's two numbers; ends after three steps, if it ends."""

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self, space: spaces.Space | None = None, endless: bool = False) -> None:
        bounds = np.array([[-2.0, 0.0], [4.0, 1.0]])
        self.action_space = space or spaces.Box(*bounds, dtype=np.float64)
        self.endless, self.taken = endless, []

    def reset(self, *, seed=None, options=None):
        self.taken = []
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.taken.append(np.asarray(action).tolist())
        cut = len(self.taken) == 3 and not self.endless
        return np.zeros(1, np.float32), np.array(action), False, cut, {}


class Steady:
    def __init__(self, action) -> None:
        self.action = np.asarray(action)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self.action, state


def test_the_ends_are_the_bounds():
    env = UnitActions(Slope())
    env.reset()
    for action in ([-1.0, -1.0], [1.0, 1.0], [0.0, 0.5]):
        env.step(np.array(action, np.float32))
    assert env.unwrapped.taken == [[-2.0, 0.0], [4.0, 1.0], [1.0, 0.75]]


@pytest.mark.parametrize("bad", [[np.nan, 0.0], [0.0], [0.0, 0.0, 0.0], [1.5, 0.0], [np.inf, 0.0]])
def test_actions_that_are_none_are_refused(bad):
    env = UnitActions(Slope())
    env.reset()
    with pytest.raises(UserError, match="action"):
        env.step(np.array(bad))


@pytest.mark.parametrize(
    ("space", "says"),
    [
        (spaces.Box(-np.inf, np.inf, (2,), np.float32), "no finite bounds"),
        (spaces.Box(1.0, 1.0, (2,), np.float32), "no finite bounds"),
        (spaces.Box(-1, 1, (2, 2), np.float32), "one vector of floats"),
        (spaces.Box(0, 9, (2,), np.int64), "one vector of floats"),
        (spaces.MultiDiscrete([2, 2]), "MultiDiscrete are not supported"),
        (spaces.Dict({"a": spaces.Discrete(2)}), "Dict are not supported"),
    ],
)
def test_spaces_of_other_kinds_are_refused(space, says):
    with pytest.raises(UserError, match=re.escape(says)):
        check_spaces(Slope(space), continuous=True)


def test_a_registered_environment_is_driven_and_recorded():
    env = make_environment("Pendulum-v1", continuous=True)
    assert (sizes(env), action_size(env)) == ((3, 0), 1)
    with pytest.raises(UserError, match="only discrete actions are supported, not Box"):
        make_environment("Pendulum-v1")
    table = rollout_env(env, Steady(np.full(1, 0.25, np.float32)), 1, seed=0).transitions
    assert table.action.shape == (200, 1) and (table.action == 0.25).all()
    assert table.n_actions == 0 and table.ending[-1] == 3


def test_a_vector_reward_is_the_pair():
    env = UnitActions(RewardPairWrapper(Slope(), angle=90.0))
    table = rollout_env(env, Steady(np.array([1.0, 0.0], np.float32)), 1, seed=0).transitions
    assert table.rewards.env.tolist() == [4.0] * 3
    assert table.rewards.social.tolist() == [0.5] * 3


@pytest.mark.parametrize("reward", [np.zeros(3), np.zeros(1), np.zeros((2, 2))])
def test_vector_rewards_of_another_length_are_refused(reward):
    told = f"a vector reward has length {reward.size}, and an angle weighs two parts: choose"
    with pytest.raises(UserError, match=told) as refused:
        RewardPair.of_step(reward, {})
    assert "\n" not in str(refused.value)


def test_a_vector_reward_of_two_parts_is_finite():
    with pytest.raises(UserError, match=r"a vector reward must be two finite numbers"):
        RewardPair.of_step(np.array([np.nan, 0.0]), {})


def test_an_environment_without_a_time_limit_is_refused(monkeypatch):
    monkeypatch.setattr("socialiq.evaluation.simulate.MOST_STEPS", 50)
    env = UnitActions(Slope(endless=True))
    with pytest.raises(UserError, match=re.escape("wrap the environment in gymnasium.wrappers.T")):
        rollout_env(env, Steady(np.zeros(2, np.float32)), 1, seed=0)
