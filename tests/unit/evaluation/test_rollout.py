import dataclasses

import gymnasium
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.exact import evaluate_exactly
from socialiq.evaluation.rollout import rollout_env, rollout_table
from socialiq.types import Ending
from socialiq.worlds import IDS
from socialiq.worlds.catalogue import GRIDS
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

WAIT, GO = 0, 1
EPISODES = 8_000
CASES = [("crossing5", {}), ("crossing7", {}), ("crossing7", {"braking": "one_level"})]


class Constant:
    """A policy of one action that remembers how it was asked."""

    def __init__(self, action=0):
        self.action, self.asked = action, []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.asked.append((state, deterministic))
        return np.array(self.action), (state or 0) + 1


def episode_means(rollout):
    """(mean, standard error) of what each episode sums up to, by name of the metric."""
    table = rollout.transitions
    lengths, starts = table.episode_lengths, table.episode_starts
    last = table.ending[starts + lengths - 1]
    sums = {
        "r_env": table.totals().env,
        "r_social": table.totals().social,
        "length": lengths,
        "arrival": last == Ending.ARRIVAL,
        "collision": last == Ending.COLLISION,
        "timeout": last == Ending.TIMEOUT,
    }
    found = {name: (s.mean(), s.std() / np.sqrt(len(s))) for name, s in sums.items()}
    moving = {"mean_speed": rollout.speed, "stopped": rollout.speed == 0.0}
    for name, column in moving.items():
        total = np.add.reduceat(column.astype(float), starts)
        ratio = total.sum() / lengths.sum()  # a ratio of means, so its error is that of residuals
        error = (total - ratio * lengths).std() / lengths.mean() / np.sqrt(len(lengths))
        found[name] = (ratio, error)
    return found


@pytest.fixture(scope="module", params=CASES, ids=str)
def played(request, tabulated, random_policy):
    name, options = request.param
    table = tabulated(name, **options)
    policy = random_policy(table, 1)
    return table, policy, rollout_table(table, policy, EPISODES, seed=0)


def test_agrees_with_exact_evaluation(played):
    table, policy, rollout = played
    exact = evaluate_exactly(table, policy)._asdict()
    for name, (mean, error) in episode_means(rollout).items():
        assert abs(mean - exact[name]) <= 4 * error + 1e-12, name


def test_metrics_are_the_means_over_episodes(played):
    _, _, rollout = played
    metrics = rollout.metrics()
    for name, (mean, _) in episode_means(rollout).items():
        assert getattr(metrics, name) == pytest.approx(mean, abs=1e-12)
    angle = np.degrees(np.arctan2(metrics.r_social, metrics.r_env))
    assert metrics.angle == pytest.approx(angle, abs=1e-9)


def test_every_ending_of_the_world_is_sampled(played):
    table, _, rollout = played
    possible = {Ending.NONE, Ending.ARRIVAL, Ending.TIMEOUT}
    if (table.reachable_part().mdp.ending == Ending.COLLISION).any():
        possible.add(Ending.COLLISION)
    assert set(np.unique(rollout.transitions.ending)) == possible


def test_angle_interval_holds_the_exact_angle(played):
    table, policy, rollout = played
    estimate = rollout.angle(seed=3)
    assert estimate.low < evaluate_exactly(table, policy).angle < estimate.high
    assert estimate.high - estimate.low < 5.0


def test_episodes_are_whole_and_connected(played):
    table, _, rollout = played
    rows = rollout.transitions
    assert rows.n_episodes == EPISODES
    assert rows.episode_lengths.max() == table.world.horizon
    starts, ends = rows.episode_starts, rows.episode_starts + rows.episode_lengths - 1
    assert (rows.ending[ends] != Ending.NONE).all()
    assert (rows.ending != Ending.NONE).sum() == EPISODES
    assert (table.mdp.initial[table.world.index(rows.observation[starts].astype(int))] > 0).all()
    inner = np.setdiff1d(np.arange(rows.n_transitions), ends)
    np.testing.assert_array_equal(rows.next_observation[inner], rows.observation[inner + 1])


def test_timeouts_come_at_the_horizon_only(played):
    table, _, rollout = played
    rows = rollout.transitions
    timed_out = rows.ending[rows.episode_starts + rows.episode_lengths - 1] == Ending.TIMEOUT
    assert (rows.episode_lengths[timed_out] == table.world.horizon).all()
    np.testing.assert_array_equal(rows.truncated, rows.ending == Ending.TIMEOUT)
    assert not (rows.terminated & rows.truncated).any()


def test_rewards_and_speed_are_those_of_the_table(played):
    table, _, rollout = played
    rows = rollout.transitions
    s = table.world.index(rows.observation.astype(int))
    np.testing.assert_array_equal(rows.rewards.env, table.mdp.rewards.env[s, rows.action])
    np.testing.assert_array_equal(rows.rewards.social, table.mdp.rewards.social[s, rows.action])
    np.testing.assert_array_equal(rollout.speed, table.speed[s, rows.action])


def test_one_seed_gives_one_rollout(table7, random_policy):
    policy = random_policy(table7, 2)
    first, same, other = (
        rollout_table(table7, policy, 50, seed=seed).transitions.arrays() for seed in (4, 4, 5)
    )
    assert all(np.array_equal(first[name], same[name]) for name in first)
    assert not all(np.array_equal(first[name], other[name]) for name in first)


def test_the_altruist_of_fig_6_1_row_by_row(table5):
    rollout = rollout_table(table5, expert_policy(table5, 90.0), 2, seed=0, mode="altruistic")
    rows = rollout.transitions
    assert rows.action.tolist() == [0, 0, 0, 0, 1, 1, 1, 1] * 2
    assert rows.observation[:8, 3].tolist() == [0, 1, 2, 3, 4, 4, 4, 4]
    assert rows.rewards.env.tolist() == [-1.0] * 7 + [9.0] + [-1.0] * 7 + [9.0]
    assert rows.rewards.social[:8].tolist() == [-1.0, -1.0, -1.0, 9.0, 0.0, 0.0, 0.0, 0.0]
    assert rows.terminated.nonzero()[0].tolist() == [7, 15]
    assert rows.mode_names == ("altruistic",)
    assert rows.source == {"world": "crossing5", "seed": 0}


def test_an_arrival_in_the_last_step_is_no_timeout(table5, always):
    table = tabulate(dataclasses.replace(table5.world, horizon=4))
    rows = rollout_table(table, always(table, GO), 1, seed=0).transitions
    assert rows.ending.tolist() == [0, 0, 0, Ending.ARRIVAL]
    table = tabulate(dataclasses.replace(table5.world, horizon=3))
    rows = rollout_table(table, always(table, GO), 1, seed=0).transitions
    assert rows.ending.tolist() == [0, 0, Ending.TIMEOUT]


def test_the_source_may_be_extended(table5, always):
    rollout = rollout_table(table5, always(table5, WAIT), 1, seed=7, source={"expert": "none"})
    assert rollout.transitions.source == {"world": "crossing5", "seed": 7, "expert": "none"}


@pytest.mark.parametrize("name", tuple(GRIDS)[:2])
def test_the_environment_agrees_with_the_table(name, tabulated, random_policy):
    table = tabulated(name)
    probabilities = random_policy(table, 3)
    expected = episode_means(rollout_table(table, probabilities, EPISODES, seed=0))
    policy = TabularPolicy(table.world, probabilities, np.random.default_rng(1))
    rollout = rollout_env(gymnasium.make(IDS[name]), policy, 120, seed=0, deterministic=False)
    for metric, (mean, error) in episode_means(rollout).items():
        close = np.hypot(error, expected[metric][1])
        assert abs(mean - expected[metric][0]) <= 4 * close + 1e-12, metric


def test_the_environment_plays_the_altruist_like_the_table(table5):
    probabilities = expert_policy(table5, 90.0)
    env = gymnasium.make(IDS["crossing5"])
    rollout = rollout_env(env, TabularPolicy(table5.world, probabilities), 2, seed=0)
    expected = rollout_table(table5, probabilities, 2, seed=0)
    for name, column in expected.transitions.arrays().items():
        np.testing.assert_array_equal(rollout.transitions.arrays()[name], column)
    np.testing.assert_array_equal(rollout.speed, expected.speed)
    assert rollout.metrics() == expected.metrics()


def test_environments_without_our_keys_end_otherwise_and_earn_r_env():
    rollout = rollout_env(gymnasium.make("CartPole-v1"), Constant(), 3, seed=0, mode="left")
    rows = rollout.transitions
    ends = rows.episode_starts + rows.episode_lengths - 1
    assert rows.n_episodes == 3
    assert (rows.ending[ends] == Ending.OTHER).all()
    assert rows.terminated.sum() == 3
    assert (rows.rewards.env == 1.0).all()
    assert (rows.rewards.social == 0.0).all()
    assert np.isnan(rollout.speed).all()
    assert rows.n_actions == 2
    assert rows.source == {"seed": 0, "episodes": 3}


def test_metrics_without_our_keys():
    metrics = rollout_env(gymnasium.make("CartPole-v1"), Constant(), 3, seed=0).metrics()
    assert metrics.r_env == metrics.length
    assert metrics.angle == 0.0
    assert (metrics.arrival, metrics.collision, metrics.timeout) == (0.0, 0.0, 0.0)
    assert np.isnan(metrics.mean_speed)
    assert np.isnan(metrics.stopped)


def test_a_truncation_is_a_timeout():
    env = gymnasium.make("CartPole-v1", max_episode_steps=5)
    rows = rollout_env(env, Constant(), 2, seed=0).transitions
    assert rows.episode_lengths.tolist() == [5, 5]
    assert rows.truncated.nonzero()[0].tolist() == [4, 9]
    assert rows.ending[[4, 9]].tolist() == [Ending.TIMEOUT] * 2


def test_episode_i_is_seeded_with_seed_plus_i():
    env = gymnasium.make("CartPole-v1")
    rows = rollout_env(env, Constant(), 2, seed=10).transitions
    first = [env.reset(seed=seed)[0] for seed in (10, 11)]
    np.testing.assert_array_equal(rows.observation[rows.episode_starts], first)


@pytest.mark.parametrize("deterministic", [True, False])
def test_the_policy_keeps_its_memory_within_an_episode(deterministic):
    policy = Constant(WAIT)
    env = gymnasium.make(IDS["crossing5"])
    rollout_env(env, policy, 2, seed=0, deterministic=deterministic)
    memory = [None, *range(1, 20)]
    assert policy.asked == [(state, deterministic) for state in memory * 2]


def test_observations_are_flattened():
    env = gymnasium.wrappers.ReshapeObservation(gymnasium.make("CartPole-v1"), (2, 2))
    rows = rollout_env(env, Constant(), 1, seed=0).transitions
    assert rows.observation.shape == (rows.n_transitions, 4)


def test_other_actions_than_discrete_are_refused():
    with pytest.raises(UserError, match=r"^only discrete actions are supported"):
        rollout_env(gymnasium.make("Pendulum-v1"), Constant(), 1, seed=0)


@pytest.mark.parametrize("episodes", [0, -1])
def test_no_episodes_are_refused(episodes, table5, always):
    line = f"^episodes must be at least 1, got {episodes}$"
    with pytest.raises(UserError, match=line):
        rollout_table(table5, always(table5, GO), episodes, seed=0)
    with pytest.raises(UserError, match=line):
        rollout_env(gymnasium.make(IDS["crossing5"]), Constant(), episodes, seed=0)


def test_an_ending_that_an_environment_misnames_is_refused():
    from socialiq.errors import UserError
    from socialiq.types import Ending

    assert Ending.of_step(True, False, {"ending": "arrival"}) is Ending.ARRIVAL
    assert Ending.of_step(True, False, {}) is Ending.OTHER
    with pytest.raises(UserError, match="choose one of arrival, collision, other"):
        Ending.of_step(True, False, {"ending": "crashed"})
