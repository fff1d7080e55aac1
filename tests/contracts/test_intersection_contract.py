"""Contract of the intersection as an environment."""

import gymnasium
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds import IDS, registry
from socialiq.worlds.gym import RoadEnv
from socialiq.worlds.highway.options import SIGNALS
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection

ID = IDS["intersection"]


@pytest.fixture
def env():
    return gymnasium.make(ID)


def walk(env, steps, seed, driver="random"):
    """A drive over several episodes: (observation, action, step)."""
    decide = policy(driver, seed)
    observation, _ = env.reset(seed=seed)
    for _ in range(steps):
        action = int(decide.predict(observation)[0])
        step = env.step(action)
        yield observation, action, step
        observation = env.reset()[0] if step[2] or step[3] else step[0]


def test_other_seeds_are_other_episodes(env):
    starts = [env.reset(seed=seed)[0] for seed in range(20)]
    assert len(np.unique(starts, axis=0)) == 20


def test_without_a_seed_it_begins_too():
    starts = [gymnasium.make(ID).reset()[0] for _ in range(3)]
    assert len(np.unique(starts, axis=0)) == 3


def test_an_unseeded_reset_is_another_episode(env):
    first, second = env.reset(seed=1)[0], env.reset()[0]
    assert (first != second).any()
    env.reset(seed=1)
    np.testing.assert_array_equal(env.reset()[0], second)


def test_info_tells_the_pairs_the_signals_and_the_ending(env):
    endings, contacts = set(), set()
    for driver in ("random", "wait", "go"):
        for *_, (_, _, terminated, truncated, info) in walk(env, 150, 1, driver):
            assert info["reward_pair"].shape == info["classical"].shape == (2,)
            assert info["reward_pair"].dtype == info["classical"].dtype == np.float64
            assert set(info["signals"]) == set(SIGNALS)
            assert {type(value) for value in info["signals"].values()} == {float}
            ending = Ending[info["ending"].upper()]
            assert (ending == Ending.NONE) == (not terminated and not truncated)
            assert (ending == Ending.TIMEOUT) == truncated
            assert not (terminated and truncated)
            assert (info["contact"] == "none") == (ending != Ending.COLLISION)
            assert type(info["neighbours_collided"]) is int
            assert type(info["speed"]) is float and -1.0 < info["speed"] <= 10.0
            assert type(terminated) is type(truncated) is bool
            endings.add(info["ending"])
            contacts.add(info["contact"])
    assert endings == {"none", "arrival", "collision", "timeout"}
    assert contacts == {"none", "ego_struck", "ego_was_struck"}


@pytest.mark.parametrize("angle", [-1.0, 360.0, float("nan"), float("inf")])
def test_angles_outside_are_refused(angle):
    with pytest.raises(UserError, match=r"is outside \[0, 360\) degrees"):
        gymnasium.make_vec(ID, angle=angle)


def test_an_episode_that_ended_must_be_reset(env):
    inner = env.unwrapped
    inner.reset(seed=0)
    while not any(inner.step(2)[2:4]):
        pass
    with pytest.raises(UserError, match="reset it first"):
        inner.step(2)
    inner.reset()
    inner.step(2)


@pytest.mark.parametrize("action", [3, -1])
def test_unknown_actions_are_refused(action):
    env = RoadEnv()
    env.reset(seed=0)
    with pytest.raises(UserError, match=r"actions must be 0 to 2"):
        env.step(action)


def test_options_reach_the_environments_world():
    env = gymnasium.make(ID, observed_vehicles=4, duration=3.0)
    assert (
        env.unwrapped.world.options
        == registry.make("intersection", observed_vehicles=4, duration=3.0).options
    )
    assert env.reset(seed=0)[0].shape == (28,)
    assert [env.step(0)[3] for _ in range(3)] == [False, False, True]


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_unknown_options_and_values_are_refused(make):
    with pytest.raises(UserError, match="unknown option of intersection 'colour': choose one of "):
        make(ID, colour="red")
    with pytest.raises(UserError, match="unknown value 'x' for zone of intersection: choose one "):
        make(ID, zone="x")


def test_names_and_sizes_agree():
    world = registry.make("intersection", observed_vehicles=6)
    assert isinstance(world, Intersection)
    assert world.n_actions == 3
    assert world.n_features == 42 == world.batch(2).reset(0).shape[1]
    assert len(set(SIGNALS)) == len(SIGNALS) == 9
    assert "observed_vehicles=6" in world.description
    assert world.description != registry.make("intersection").description


def test_worlds_of_equal_options_are_equal():
    assert registry.make("intersection", duration=5.0) == registry.make(
        "intersection", duration=5.0
    )
    assert registry.make("intersection", duration=5.0) != registry.make("intersection")
