"""Episodes behind Gymnasium's vector interface: as single environments, in every reset mode."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds import IDS
from socialiq.worlds.gym import RoadEnv, RoadVectorEnv
from socialiq.worlds.highway.options import Contact

SIZE, STEPS = 5, 200
ANGLE = 30.0


def both(mode, **options):
    """The vector environment, and single ones side by side."""
    singles = [lambda: RoadEnv(angle=ANGLE, **options)] * SIZE
    return (
        RoadVectorEnv(num_envs=SIZE, angle=ANGLE, autoreset_mode=mode, **options),
        SyncVectorEnv(singles, autoreset_mode=mode),
    )


def assert_same_step(step, expected):
    observation, reward, terminated, truncated, info = step
    np.testing.assert_array_equal(observation, expected[0])
    np.testing.assert_array_equal(reward, expected[1])
    np.testing.assert_array_equal(terminated, expected[2])
    np.testing.assert_array_equal(truncated, expected[3])
    for column, other in zip(step[:4], expected[:4], strict=True):
        assert column.dtype == other.dtype
    assert_same_info(info, expected[4])


def assert_same_info(info, expected):
    """The quantities of the rows whose mask is set."""
    for name in ("reward_pair", "speed", "classical", "neighbours_collided"):
        if name in expected:
            mask = expected[f"_{name}"]
            assert info[f"_{name}"][mask].all()
            np.testing.assert_array_equal(info[name][mask], expected[name][mask])
    for name, words in (("ending", Ending), ("contact", Contact)):
        for row in np.flatnonzero(expected.get(f"_{name}", [])):
            assert words(info[name][row]).name.lower() == expected[name][row]
    for name, values in expected.get("signals", {}).items():
        if not name.startswith("_"):
            mask = expected["signals"][f"_{name}"]
            np.testing.assert_array_equal(info["signals"][name][mask], values[mask])


def test_next_step_resets_like_single_environments(actions_of):
    ours, theirs = both(AutoresetMode.NEXT_STEP)
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    ended = np.zeros(SIZE, bool)
    resets = 0
    for _, action in zip(range(STEPS), actions_of(SIZE, 0), strict=False):
        step, expected = ours.step(action), theirs.step(action)
        assert_same_step(step, expected)
        assert not step[1][ended].any()
        np.testing.assert_array_equal(step[4]["_reward_pair"], ~ended)
        ended = step[2] | step[3]
        resets += ended.sum()
    assert resets > 20


def test_same_step_resets_like_single_environments(actions_of):
    ours, theirs = both(AutoresetMode.SAME_STEP)
    ours.reset(seed=3), theirs.reset(seed=3)
    resets = 0
    for _, action in zip(range(STEPS), actions_of(SIZE, 0), strict=False):
        step, expected = ours.step(action), theirs.step(action)
        ended = step[2] | step[3]
        resets += ended.sum()
        found, wanted = step[4], expected[4]
        assert ("final_obs" in found) == ("final_obs" in wanted) == ended.any()
        if ended.any():
            np.testing.assert_array_equal(found["_final_obs"], wanted["_final_obs"])
            for row, (final, other) in enumerate(
                zip(found["final_obs"], wanted["final_obs"], strict=True)
            ):
                assert (final is None) == (other is None) == (not ended[row])
                np.testing.assert_array_equal(final, other)
            # what the decision that ended it led to, which Gymnasium calls final_info
            assert_same_info(found, wanted["final_info"])
        # of rows that were reset, Gymnasium's own info is that of the reset: there is none
        assert_same_step(step, expected)
    assert resets > 20


def test_disabled_resets_are_the_callers(actions_of):
    ours, theirs = both(AutoresetMode.DISABLED)
    ours.reset(seed=3), theirs.reset(seed=3)
    resets = 0
    for _, action in zip(range(STEPS), actions_of(SIZE, 0), strict=False):
        step = ours.step(action)
        assert_same_step(step, theirs.step(action))
        ended = step[2] | step[3]
        if ended.any():
            with pytest.raises(UserError, match="reset it first, with options reset_mask"):
                ours.step(action)
            seen = [env.reset(options={"reset_mask": ended.copy()})[0] for env in (ours, theirs)]
            np.testing.assert_array_equal(*seen)
            np.testing.assert_array_equal(seen[0][~ended], step[0][~ended])
            resets += ended.sum()
    assert resets > 20


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_info_has_every_quantity_of_a_single_environment(mode):
    ours, single = RoadVectorEnv(num_envs=2, autoreset_mode=mode), RoadEnv()
    ours.reset(seed=[4, 5]), single.reset(seed=5)
    info, expected = ours.step([2, 2])[4], single.step(2)[4]
    assert set(expected) <= set(info)
    assert {name for name in info if not name.startswith("_")} == set(expected)
    assert set(info["signals"]) == set(expected["signals"])
    assert info["ending"][1] == Ending[expected["ending"].upper()]
    assert info["contact"][1] == Contact[expected["contact"].upper()]


def test_seeds_are_one_number_or_a_list():
    env, single = RoadVectorEnv(num_envs=3), RoadEnv()
    seen = env.reset(seed=7)[0]
    np.testing.assert_array_equal(seen, env.reset(seed=[7, 8, 9])[0])
    np.testing.assert_array_equal(seen[2], single.reset(seed=9)[0])
    mask = np.array([True, False, True])
    again = env.reset(seed=[1, 2, 3], options={"reset_mask": mask})[0]
    np.testing.assert_array_equal(again[1], seen[1])
    np.testing.assert_array_equal(again[2], single.reset(seed=3)[0])


def test_it_begins_without_a_seed():
    env = RoadVectorEnv(num_envs=3)
    first, info = env.reset()
    assert info == {} and len(np.unique(first, axis=0)) == 3
    assert env.observation_space.contains(first)
    assert (env.reset()[0] != first).any(axis=1).all()


def test_a_reset_forgets_who_had_ended():
    env = RoadVectorEnv(num_envs=2)
    env.reset(seed=0)
    while not (ended := np.logical_or(*env.step([2, 2])[2:4])).any():
        pass
    env.reset(seed=0)
    assert env.step([2, 2])[4]["_speed"].all() and ended.any()


@pytest.mark.two_cores
def test_gymnasium_makes_it_vectorised():
    env = gymnasium.make_vec(
        IDS["intersection"], num_envs=3, angle=90.0, threads=2, observed_vehicles=5
    )
    inner = env.unwrapped
    assert isinstance(inner, RoadVectorEnv)
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    assert env.num_envs == 3 and env.single_action_space.n == 3
    assert env.observation_space.shape == (3, 35)
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    observation, reward, *_, info = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    np.testing.assert_allclose(reward, info["reward_pair"][:, 1], atol=1e-12)
    env.close()


def test_sampled_actions_fit():
    env = RoadVectorEnv(num_envs=4)
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(10):
        observation, reward, *_ = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert reward.shape == (4,) and np.isfinite(reward).all()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_clock_counts_the_decisions_since_the_reset(actions_of, mode):
    ours, theirs = both(mode, clock=True)
    assert ours.single_observation_space == theirs.single_observation_space
    seen = ours.reset(seed=3)[0]
    np.testing.assert_array_equal(seen, theirs.reset(seed=3)[0])
    assert seen.shape == (SIZE, 71) and ours.single_observation_space.high[-1] == 20.0
    time, ended = np.zeros(SIZE), np.zeros(SIZE, bool)
    for _, action in zip(range(60), actions_of(SIZE, 0), strict=False):
        step, expected = ours.step(action), theirs.step(action)
        assert_same_step(step, expected)
        ended = step[2] | step[3] if mode == AutoresetMode.SAME_STEP else ended
        for row in np.flatnonzero(ended & ("final_obs" in step[4])):
            assert step[4]["final_obs"][row][-1] == time[row] + 1
        time = np.where(ended, 0, time + 1)
        np.testing.assert_array_equal(step[0][:, -1], time)
        ended = step[2] | step[3]
    plain = RoadVectorEnv(num_envs=SIZE, angle=ANGLE)
    np.testing.assert_array_equal(plain.reset(seed=3)[0], seen[:, :-1])
