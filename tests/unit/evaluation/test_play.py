"""Seeded episodes: every seed once, the same in any batch, summed up as by hand, recorded."""

from itertools import pairwise

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.episodes import conflict_at_junction, episodes_of
from socialiq.evaluation.rollout import Recorded, record
from socialiq.evaluation.simulate import play
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import angle_of
from socialiq.types import Ending
from socialiq.worlds.highway.options import SIGNALS
from socialiq.worlds.intersection.options import FASTER, SLOWER
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection

SEEDS = [5, 900, 17, 17, 2**40, 3, 0, 88, 61, 12, 13, 14, 15, 16, 40, 41, 42, 43, 44, 45]


@pytest.fixture(scope="module")
def batch():
    return Intersection().batch(7)


@pytest.fixture(scope="module")
def played(batch):
    return episodes_of(batch, policy("gap_3s"), SEEDS)


@pytest.mark.parametrize("name", ["gap_3s", "go", "stop_line"])
def test_the_batchs_size_does_not_matter(name, batch):
    runs = [
        episodes_of(one, policy(name), SEEDS)
        for one in (Intersection().batch(1), batch, Intersection().batch(64))
    ]
    for run in runs[1:]:
        for column, values in run.items():
            np.testing.assert_array_equal(values, runs[0][column], err_msg=column)


def test_what_was_played_before_does_not_matter(batch, played):
    again = episodes_of(batch, policy("gap_3s"), SEEDS[::-1])
    for name, values in played.items():
        np.testing.assert_array_equal(values, again[name][::-1])


def test_seeds_may_be_an_array(batch, played):
    again = episodes_of(batch, policy("gap_3s"), np.array(SEEDS))
    np.testing.assert_array_equal(again.totals.env, played.totals.env)


@pytest.mark.parametrize("size", [1, 7, 64])
def test_every_seed_is_played_once_to_its_end(size):
    batch, starts = Intersection().batch(size), {}
    ends, lengths = np.zeros(len(SEEDS), int), np.zeros(len(SEEDS), int)
    for step in play(batch, policy("stop_line"), SEEDS):
        for row in np.flatnonzero(step.running):
            number = step.episode[row]
            assert not ends[number]
            starts.setdefault(number, step.observation[row].copy())
            lengths[number] += 1
            ends[number] += step.made.ending[row] != Ending.NONE
        assert len(set(step.episode[step.running].tolist())) == step.running.sum()
    assert (ends == 1).all()
    expected = episodes_of(batch, policy("stop_line"), SEEDS).length
    np.testing.assert_array_equal(lengths, expected)
    begin = Intersection().batch(len(SEEDS)).reset(SEEDS)
    np.testing.assert_array_equal([starts[number] for number in range(len(SEEDS))], begin)


def test_the_batch_stays_full_until_seeds_run_out(batch):
    running = [step.running.sum() for step in play(batch, policy("go"), range(40))]
    assert (np.diff(running) <= 0).all()
    assert running[0] == 7 and running.count(7) > len(running) / 2


def test_sums_are_those_of_a_hand_played_episode(played):
    for number in range(6):
        batch, driver = Intersection().batch(1), policy("gap_3s")
        observation, steps = batch.reset([SEEDS[number]]), []
        met, slower, beyond = [], [], []
        while not steps or not steps[-1].ending[0]:
            action = driver.predict(observation)[0]
            met.append(bool(conflict_at_junction(observation)[0]))
            slower.append(action[0] == SLOWER)
            steps.append(batch.step(action, auto_reset=False))
            observation = batch.observation
            beyond.append(steps[-1].observation[0, 2] < 0.11)
        rewards = np.array([step.rewards for step in steps])[..., 0]
        classical = np.array([step.classical for step in steps])[..., 0]
        speeds = np.array([step.speed[0] for step in steps])
        signals = np.array([[step.signals[name][0] for name in SIGNALS] for step in steps])
        expected = {
            "r_env": rewards[:, 0].sum(),
            "r_social": rewards[:, 1].sum(),
            "classical_own": classical[:, 0].sum(),
            "classical_others": classical[:, 1].sum(),
            "ending": steps[-1].ending[0],
            "contact": steps[-1].contact[0],
            "length": len(steps),
            "speed": speeds.mean(),
            "stopped": (speeds < 0.5).mean(),
            "neighbours_collided": sum(step.neighbours_collided[0] for step in steps),
            **{f"signal_{name}": signals[:, k].sum() for k, name in enumerate(SIGNALS)},
            **{f"active_{name}": (signals[:, k] != 0).sum() for k, name in enumerate(SIGNALS)},
            "entered": any(beyond),
            "conflicts": sum(met),
            "off_road": any(step.off_road[0] for step in steps),
            "pressed": sum(one and not slow for one, slow in zip(met, slower, strict=True)),
        }
        assert set(played) == set(expected)
        for name, value in expected.items():
            np.testing.assert_allclose(played[name][number], value, atol=1e-12, err_msg=name)


def test_metrics_are_means_over_the_episodes(played):
    metrics = played.metrics()
    env, social = played.totals.env.mean(), played.totals.social.mean()
    assert (metrics.r_env, metrics.r_social) == pytest.approx((env, social))
    assert metrics.angle == pytest.approx(angle_of(env, social))
    shares = [(played.ending == kind).mean() for kind in (1, 2, 3)]
    assert [metrics.arrival, metrics.collision, metrics.timeout] == pytest.approx(shares)
    assert sum(shares) == 1 and shares[0] > 0
    assert metrics.mean_speed == pytest.approx(played.speed.mean())
    assert metrics.stopped == pytest.approx(played.stopped.mean())
    assert metrics.length == pytest.approx(played.length.mean())


def test_a_policy_that_waits_stands(batch):
    episodes = episodes_of(batch, policy("wait"), range(30))
    late = episodes.ending == Ending.TIMEOUT
    assert late.sum() > 5
    assert (episodes.length[late] == 20).all()
    assert (episodes.stopped[late] > 0.5).all() and (episodes.speed[late] < 3).all()


def test_the_policy_is_told_whether_to_be_deterministic(batch):
    class Asked:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            asked.append(deterministic)
            return np.full(len(observation), 2), state

    asked = []
    episodes_of(batch, Asked(), [1, 2])
    assert asked and all(asked)
    asked.clear()
    episodes_of(batch, Asked(), [1, 2], deterministic=False)
    assert asked and not any(asked)


@pytest.mark.parametrize("seeds", [[], np.array([], int)])
def test_no_seeds_are_refused(seeds, batch):
    with pytest.raises(UserError, match=r"^episodes must be at least 1, got 0$"):
        episodes_of(batch, policy("go"), seeds)


def test_who_waits_never_enters_and_who_goes_always_does(batch):
    waits, goes = (episodes_of(batch, policy(name), range(40)) for name in ("wait", "go"))
    assert not waits.entered.any() and waits.conflicts.any() and not waits.pressed.any()
    assert goes.entered.mean() > 0.9
    np.testing.assert_array_equal(goes.pressed, goes.conflicts)  # it never goes slower


@pytest.fixture(scope="module")
def soft():
    """A made-up network that takes every action now and then."""
    rng = np.random.default_rng(0)
    sizes = (70, 16, 3)
    weights = [rng.normal(size=(o, i)).astype(np.float32) for i, o in pairwise(sizes)]
    biases = [np.zeros(size, np.float32) for size in sizes[1:]]
    return QPolicy(tuple(weights), tuple(biases), "relu", 3.0)


def soft_episodes(size, policy, seeds):
    return episodes_of(Intersection().batch(size), policy, seeds, deterministic=False)


@pytest.mark.parametrize("size", [1, 7, 64])
def test_soft_draws_belong_to_the_episode(size, soft):
    expected, found = (soft_episodes(one, soft, SEEDS) for one in (len(SEEDS), size))
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    again = soft_episodes(size, soft, SEEDS[::-1])
    np.testing.assert_array_equal(again.r_env[::-1], expected.r_env)
    assert expected.r_env[2] == expected.r_env[3]  # the seed is the same


def test_soft_play_leaves_the_policys_own_stream_alone(soft):
    before = soft.rng.bit_generator.state
    soft_episodes(4, soft, [1, 2])
    assert soft.rng.bit_generator.state == before


def test_soft_actions_are_drawn_as_often_as_the_policy_says(batch):
    class Coin:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            raise AssertionError("its probabilities are asked instead")

        def probabilities(self, observations):
            return np.tile([0.5, 0.2, 0.3], (len(observations), 1))

    actions = [
        step.action[step.running] for step in play(batch, Coin(), range(300), deterministic=False)
    ]
    counts = np.bincount(np.concatenate(actions))
    shares = counts / counts.sum()
    # some 4,000 draws: the standard error of a half is 0.8 %
    np.testing.assert_allclose(shares, [0.5, 0.2, 0.3], atol=0.03)
    assert (actions[0] != actions[1]).any()  # a row's decisions are draws of their own


def test_a_soft_policy_that_is_deterministic_takes_its_best_action(batch, soft):
    for step in play(batch, soft, SEEDS[:7]):
        best = soft.q_values(step.observation).argmax(axis=1)
        np.testing.assert_array_equal(step.action, best)


RECORDED = [5, 900, 17, 17, 3, 0, 88, 61]


def recorded(size: int = 3, name: str = "gap_3s") -> Recorded:
    return record(Intersection().batch(size), policy(name), RECORDED, "careful", {"policy": name})


@pytest.fixture(name="rows", scope="module")
def some_episodes():
    return recorded()


def test_rows_of_an_episode_are_adjacent_and_counted(rows):
    table = rows.transitions
    assert table.n_episodes == len(RECORDED)
    assert (np.diff(table.episode) >= 0).all()
    lengths = np.bincount(table.episode)
    assert len({*lengths.tolist()}) > 1
    np.testing.assert_array_equal(table.step, np.concatenate([np.arange(n) for n in lengths]))


def test_what_is_seen_next_is_what_was_reached(rows):
    table = rows.transitions
    within = table.episode[1:] == table.episode[:-1]
    follows = (table.next_observation[:-1] == table.observation[1:]).all(axis=1)
    np.testing.assert_array_equal(follows, within)


def test_an_episode_begins_with_its_seed_and_is_over_at_its_last_row(rows):
    table = rows.transitions
    first = np.flatnonzero(table.step == 0)
    begin = Intersection().batch(len(RECORDED)).reset(RECORDED)
    np.testing.assert_array_equal(table.observation[first], begin)
    ended = np.append(table.step[1:] == 0, True)
    np.testing.assert_array_equal(table.ending != Ending.NONE, ended)
    np.testing.assert_array_equal(table.terminated | table.truncated, ended)
    np.testing.assert_array_equal(table.truncated, table.ending == Ending.TIMEOUT)


def test_actions_are_the_policys(rows):
    table = rows.transitions
    np.testing.assert_array_equal(table.action, policy("gap_3s").predict(table.observation)[0])
    assert len({*table.action.tolist()}) > 1


@pytest.mark.parametrize("name", ["gap_3s", "go", "wait"])
def test_sums_are_those_of_evaluation(name):
    made = recorded(name=name)
    table = made.transitions
    expected = episodes_of(Intersection().batch(5), policy(name), RECORDED)

    def sums(column):
        return np.bincount(table.episode, column)

    np.testing.assert_array_equal(sums(table.rewards.env), expected.totals.env)
    np.testing.assert_array_equal(sums(table.rewards.social), expected.totals.social)
    np.testing.assert_array_equal(sums(made.classical.env), expected.classical_own)
    np.testing.assert_array_equal(sums(made.classical.social), expected.classical_others)
    np.testing.assert_array_equal(np.bincount(table.episode), expected.length)
    np.testing.assert_array_equal(table.ending[table.ending != 0], expected.ending)


@pytest.mark.parametrize("size", [1, 2, 8, 20])
def test_a_recording_is_the_same_in_any_batch(size, rows):
    again = recorded(size)
    for name, column in rows.transitions.arrays().items():
        np.testing.assert_array_equal(again.transitions.arrays()[name], column, err_msg=name)
    for found, expected in zip(again.classical, rows.classical, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_the_table_says_who_drove_and_which_seeds(rows):
    table = rows.transitions
    assert table.mode_names == ("careful",) and not table.mode.any()
    assert table.source == {"first_seed": 0, "episodes": 8, "policy": "gap_3s"}
    assert table.n_actions == 3


def test_a_recording_needs_seeds():
    with pytest.raises(UserError, match=r"^episodes must be at least 1, got 0$"):
        record(Intersection().batch(2), policy("go"), [], "go")


class Waiter:
    """Waits until a time, then goes; takes the time as its last feature."""

    n_features = 71

    def __init__(self, until):
        self.until, self.seen = until, []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        time = observation[:, -1]
        self.seen.append(time)
        return np.where(time < self.until, SLOWER, FASTER), state


def test_a_policy_with_one_feature_more_sees_the_decisions_of_each_episode():
    """Two rows, so that episodes begin at different times."""
    driver, batch = Waiter(3), Intersection().batch(2)
    lengths, first = np.zeros(5, int), True
    for step in play(batch, driver, range(5)):
        assert step.observation.shape == (2, 70)
        for row in np.flatnonzero(step.running):
            assert driver.seen[-1][row] == lengths[step.episode[row]]
            lengths[step.episode[row]] += 1
        first = False
    assert not first and len(set(lengths.tolist())) > 1
    waits = episodes_of(batch, Waiter(99), range(20)).metrics()
    assert waits.timeout == 1.0
    assert episodes_of(batch, Waiter(3), range(20)).metrics().timeout < 0.5


def test_what_a_policy_sees_depends_on_its_features():
    batch = Intersection().batch(3)
    batch.reset(0)
    batch.step(np.full(3, SLOWER))
    np.testing.assert_array_equal(batch.seen_by(policy("wait")), batch.observation)
    seen = batch.seen_by(Waiter(1))
    np.testing.assert_array_equal(seen[:, :-1], batch.observation)
    assert seen[:, -1].tolist() == [1.0] * 3 and seen.dtype == np.float32
