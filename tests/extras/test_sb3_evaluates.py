"""Stable-Baselines3's own `evaluate_policy` takes our policies as it takes its own."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("torch", reason="extra `sb3` is not installed")
pytest.importorskip("stable_baselines3", reason="extra `sb3` is not installed")

from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from socialiq.errors import UserError
from socialiq.evaluation.rollout import rollout_env
from socialiq.nn.q_policy import QPolicy
from socialiq.worlds import IDS
from socialiq.worlds.intersection import atlas


def always(action):
    """A policy of the 7x7 world that does one thing: 0 stop, 1 slow, 2 fast."""
    bias = np.eye(3, dtype=np.float32)[action]
    return QPolicy((np.zeros((3, 6), np.float32),), (bias,), "relu", 1.0)


@pytest.mark.parametrize(("workers", "action"), [(1, 2), (3, 2), (3, 1)])
def test_returns_are_those_of_our_own_rollouts_in_the_grid(workers, action):
    env = make_vec_env(IDS["crossing7"], workers, seed=7, env_kwargs={"angle": 45.0})
    policy = always(action)
    returns, lengths = evaluate_policy(policy, env, 60, return_episode_rewards=True)
    assert len(returns) == len(lengths) == 60 and max(lengths) <= 25
    ours = rollout_env(gymnasium.make(IDS["crossing7"]), policy, 400, 7).transitions
    expected = (ours.totals().env + ours.totals().social) * np.sqrt(0.5)
    # SB3 rounds returns to six decimals; going fast they are all the same.
    spread = expected.std() * (60**-0.5 + 400**-0.5)
    assert np.mean(returns) == pytest.approx(expected.mean(), abs=4 * spread + 1e-5)
    assert np.mean(lengths) == pytest.approx(ours.episode_lengths.mean(), abs=1.0)
    env.close()


def test_returns_are_equal_in_the_intersection():
    """One episode a seed: the same traffic, so the same return to the last bit but float32."""
    policy = atlas.load("set_egoistic")
    table = rollout_env(gymnasium.make(IDS["intersection"]), policy, 3, 7).transitions
    for episode, seed in enumerate((7, 8, 9)):
        env = DummyVecEnv([lambda: Monitor(gymnasium.make(IDS["intersection"]))])
        env.seed(seed)
        returns, lengths = evaluate_policy(policy, env, 1, return_episode_rewards=True)
        assert lengths == [table.episode_lengths[episode]]
        assert returns[0] == pytest.approx(table.totals().env[episode], abs=1e-4)
        env.close()


def test_soft_policies_draw():
    env = make_vec_env(IDS["crossing7"], 2, seed=0)
    policy = QPolicy((np.zeros((3, 6), np.float32),), (np.zeros(3, np.float32),), "relu", 1.0)
    _, greedy = evaluate_policy(policy, env, 8, return_episode_rewards=True)
    _, soft = evaluate_policy(policy, env, 8, deterministic=False, return_episode_rewards=True)
    assert len(set(soft)) > 1 and sorted(greedy) != sorted(soft)
    env.close()


def test_what_predict_gives_is_what_stable_baselines_gives():
    policy = always(2)
    state = ("passed", "through")
    one, same = policy.predict(np.zeros(6, np.float32), state, np.array([True]))
    many, _ = policy.predict(np.zeros((4, 6), np.float32), None, np.zeros(4, bool))
    assert same is state
    assert isinstance(one, np.ndarray) and one.shape == () and int(one) == 2
    assert many.shape == (4,) and many.dtype.kind == "i"


def test_observations_of_other_worlds_are_one_line():
    policy = always(2)
    for observation, match in (
        ({"road": np.zeros(6)}, "observation is a dict"),
        (np.zeros((2, 3, 6)), r"takes \(6,\)"),
        (np.zeros(5), r"takes \(6,\)"),
        (np.zeros((1, 5)), r"takes \(6,\)"),
        ("forward", "not numeric"),
        ([[1.0], [1.0, 2.0]], "not numeric"),
    ):
        with pytest.raises(UserError, match=match):
            policy.predict(observation)
