"""A gridworld that shows the time: the same world with one feature more."""

import jax
import numpy as np
import pytest

from socialiq.types import Ending
from socialiq.worlds import registry
from socialiq.worlds.catalogue import GRIDS
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.gym import GridWorldEnv


@pytest.fixture(name="world", params=GRIDS)
def clocked(request):
    return registry.make_grid(request.param).with_clock()


def test_the_last_feature_is_the_time(world):
    plain = registry.make_grid(world.name)
    assert world.n_features == plain.n_features + 1
    assert world.observed[:-1] == plain.features
    assert world.observed[-1] == ("time", 0, world.horizon + 1)
    assert world.description != plain.description


def test_simulated_episodes_count_up_to_the_horizon(world):
    episode, observation = world.reset(jax.random.key(0))
    assert observation[-1] == 0
    for time in range(1, world.horizon + 1):
        episode, step = world.advance(jax.random.key(time), episode, 0)  # action 0 waits
        assert step.observation[-1] == time
        np.testing.assert_array_equal(step.observation[:-1], episode.state)
        if step.ending:
            break
    assert step.ending == (Ending.TIMEOUT if time == world.horizon else Ending.ARRIVAL)


def test_the_environment_shows_it_too(world):
    env = GridWorldEnv(world.name, clock=True)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation) and observation[-1] == 0
    observation, *_ = env.step(0)
    assert env.observation_space.contains(observation) and observation[-1] == 1


def test_a_table_tells_what_is_seen_at_a_time(world):
    table = tabulate(world)
    states = np.array([0, 1])
    seen = table.observe(states, np.array([3, 4]))
    np.testing.assert_array_equal(seen[:, :-1], table.states[states])
    assert seen[:, -1].tolist() == [3, 4]
    plain = tabulate(registry.make_grid(world.name))
    np.testing.assert_array_equal(plain.observe(states, np.array([3, 4])), plain.states[states])
