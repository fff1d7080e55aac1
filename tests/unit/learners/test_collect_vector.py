"""Experience from environments side by side: which rows, in which order, and what was reached."""

from collections.abc import Callable

import jax
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from socialiq.errors import UserError
from socialiq.learners.collect import from_vector_env
from socialiq.learners.expert_table import Batch
from socialiq.types import Ending
from socialiq.worlds.gym import RoadVectorEnv
from socialiq.worlds.intersection.options import FASTER

ENVS, STEPS = 3, 120
OPTIONS = {"duration": 6.0, "observed_vehicles": 3}  # short episodes: many ends


def vector(mode: AutoresetMode = AutoresetMode.SAME_STEP, envs: int = ENVS) -> RoadVectorEnv:
    return RoadVectorEnv(num_envs=envs, autoreset_mode=mode, **OPTIONS)


def faster(observation: np.ndarray) -> np.ndarray:
    return np.full(len(observation), FASTER)


def collected(steps: int = STEPS, act: Callable = faster, seed: int = 0) -> Batch:
    batch = from_vector_env(vector(), steps)(act, np.random.default_rng(seed))
    return jax.tree.map(np.asarray, batch)


@pytest.fixture(name="batch", scope="module")
def some_rows():
    return collected()


def of_env(column: np.ndarray, env: int) -> np.ndarray:
    return column[env::ENVS]


def test_rows_of_one_time_stand_together_in_the_order_of_the_environments(batch):
    """The environments are begun with seed, seed + 1, ... of the first draw."""
    seed = int(np.random.default_rng(0).integers(2**31))
    for number in range(ENVS):
        alone = vector(envs=1)
        observation, _ = alone.reset(seed=seed + number)
        for time in range(STEPS // ENVS):
            row = time * ENVS + number
            np.testing.assert_array_equal(batch.observation[row], observation[0])
            observation, _, _, _, info = alone.step(np.array([FASTER]))
            assert batch.action[row] == FASTER
            assert batch.ending[row] == info["ending"][0]
            pair = np.float32(info["reward_pair"][0])
            assert [batch.target.env[row], batch.target.social[row]] == pair.tolist()


def test_what_an_ended_episode_reached_is_not_the_next_ones_start(batch):
    ends = 0
    for number in range(ENVS):
        seen, reached, ending = (
            of_env(column, number)
            for column in (batch.observation, batch.next_observation, batch.ending)
        )
        follows = (reached[:-1] == seen[1:]).all(axis=1)
        np.testing.assert_array_equal(follows, ending[:-1] == Ending.NONE)
        ended = np.flatnonzero(ending[:-1])
        # an episode starts some 45 m south of the centre, and it has come 20 m nearer
        assert (reached[ended, 2] + 0.2 < seen[ended + 1, 2]).all()
        ends += len(ended)
    assert ends >= 10


def test_the_same_random_numbers_give_the_same_rows_whatever_came_before(batch, assert_same):
    source = from_vector_env(vector(), STEPS)
    source(faster, np.random.default_rng(1))
    assert_same(source(faster, np.random.default_rng(0)), batch)
    assert (collected(seed=1).observation != batch.observation).any()


@pytest.mark.parametrize("steps", [1, 3, 7, 8])
def test_there_are_as_many_rows_as_steps(batch, assert_same, steps):
    some = collected(steps)
    assert len(some.action) == steps
    assert_same(some, jax.tree.map(lambda column: column[:steps], batch))


def test_the_driver_sees_all_environments_and_its_actions_are_kept():
    asked: list[np.ndarray] = []

    def act(observation: np.ndarray) -> np.ndarray:
        asked.append(observation)
        return np.arange(ENVS)

    batch = collected(4 * ENVS, act)
    np.testing.assert_array_equal(batch.observation, np.concatenate(asked))
    assert batch.action.tolist() == [0, 1, 2] * 4


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_environments_that_reset_at_another_time_are_refused(mode):
    with pytest.raises(UserError, match=r"must reset in the same step: AutoresetMode\.SAME_STEP$"):
        from_vector_env(vector(mode), STEPS)


def test_actions_that_are_not_discrete_are_refused():
    env = vector()
    env.single_action_space = spaces.Box(-1.0, 1.0, (1,))
    with pytest.raises(UserError, match="only discrete actions"):
        from_vector_env(env, STEPS)
