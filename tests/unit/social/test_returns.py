import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialiq.errors import UserError
from socialiq.social.returns import (
    TARGET_KINDS,
    advantage,
    cumulative,
    mean_by_state,
    running,
    to_go,
    trajectory,
)

rewards_of_an_episode = st.lists(st.floats(-100, 100), min_size=1, max_size=20).map(np.array)


discounts = st.floats(0, 1)


# Two episodes, (1, 2, 4) and (8, 16), and discount 1/2, worked by hand.
BY_HAND = {
    "running": [1.0, 2.0, 3.0, 8.0, 16.0],
    "to_go": [3.0, 4.0, 4.0, 16.0, 16.0],
    "trajectory": [3.0, 3.0, 3.0, 16.0, 16.0],
    "instantaneous": [1.0, 2.0, 4.0, 8.0, 16.0],
}


def test_every_reading_is_worked_by_hand():
    assert set(BY_HAND) == set(TARGET_KINDS)


@pytest.mark.parametrize("kind", BY_HAND)
@pytest.mark.parametrize("episode", [[0, 0, 0, 1, 1], [7, 7, 7, 3, 3]])
def test_readings_by_hand_over_two_episodes(kind, episode):
    rewards = np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    np.testing.assert_array_equal(cumulative(kind, rewards, np.array(episode), 0.5), BY_HAND[kind])


@pytest.mark.parametrize(
    ("discount", "kind", "expected"),
    [
        (0.0, "running", [5.0, 5.0, 5.0]),  # 0 ** 0 = 1: only the first reward counts
        (0.0, "to_go", [5.0, -1.0, 3.0]),
        (1.0, "running", [5.0, 4.0, 7.0]),
        (1.0, "to_go", [7.0, 2.0, 3.0]),
        (1.0, "trajectory", [7.0, 7.0, 7.0]),
    ],
)
def test_readings_at_the_ends_of_the_discount(discount, kind, expected):
    rewards = np.array([5.0, -1.0, 3.0])
    found = cumulative(kind, rewards, np.zeros(3, np.int32), discount)
    np.testing.assert_array_equal(found, expected)


@given(rewards_of_an_episode, discounts)
def test_to_go_obeys_its_recursion(rewards, discount):
    targets = to_go(rewards, discount)
    following = np.append(targets[1:], 0.0)
    np.testing.assert_allclose(targets, rewards + discount * following, rtol=0, atol=1e-9)


@given(rewards_of_an_episode, discounts)
def test_the_readings_meet_in_the_whole_return(rewards, discount):
    whole = sum(discount**k * r for k, r in enumerate(rewards))
    assert trajectory(rewards, discount) == pytest.approx([whole] * len(rewards), abs=1e-9)
    assert running(rewards, discount)[-1] == pytest.approx(whole, abs=1e-9)
    assert to_go(rewards, discount)[0] == pytest.approx(whole, abs=1e-9)


@given(st.lists(rewards_of_an_episode, min_size=1, max_size=5), st.sampled_from(list(BY_HAND)))
def test_episodes_do_not_touch_each_other(episodes, kind):
    numbers = np.repeat(np.arange(len(episodes)), [len(rewards) for rewards in episodes])
    together = cumulative(kind, np.concatenate(episodes), numbers, 0.9)
    alone = [TARGET_KINDS[kind](rewards, 0.9) for rewards in episodes]
    np.testing.assert_array_equal(together, np.concatenate(alone))


@pytest.mark.parametrize("kind", TARGET_KINDS)
def test_the_rewards_are_left_as_they_were(kind):
    rewards = np.array([1.0, 2.0])
    cumulative(kind, rewards, np.zeros(2, np.int32), 0.5)[:] = 99.0
    np.testing.assert_array_equal(rewards, [1.0, 2.0])


def test_an_unknown_reading_is_refused():
    with pytest.raises(UserError, match="unknown target kind 'total': choose one of running"):
        cumulative("total", np.ones(2), np.zeros(2, np.int32), 0.9)


# Two episodes from state A at discount 1/2: A -1-> B -4-> end, and A -3-> end.
REWARDS, EPISODE = np.array([1.0, 4.0, 3.0]), np.array([0, 0, 1])


OBSERVATION = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])


def test_advantages_by_hand():
    """G = 3, 4, 3; V(A) = 3 and V(B) = 4; A = 1 + 4/2 - 3, 4 - 4, 3 - 3."""
    value = mean_by_state(OBSERVATION, cumulative("to_go", REWARDS, EPISODE, 0.5))
    np.testing.assert_array_equal(value, [3.0, 4.0, 3.0])
    np.testing.assert_array_equal(advantage(REWARDS, value, EPISODE, 0.5), [0.0, 0.0, 0.0])


def test_a_step_that_turned_out_better_than_usual():
    """With 5 in place of 3, V(A) = (3 + 5) / 2: the first way is one worse, the second better."""
    rewards = np.array([1.0, 4.0, 5.0])
    value = mean_by_state(OBSERVATION, cumulative("to_go", rewards, EPISODE, 0.5))
    np.testing.assert_array_equal(value, [4.0, 4.0, 4.0])
    np.testing.assert_array_equal(advantage(rewards, value, EPISODE, 0.5), [-1.0, 0.0, 1.0])


@given(st.lists(st.integers(1, 6), min_size=1, max_size=5), st.floats(0, 1), st.integers(0, 99))
def test_its_returns_to_go_are_those_of_the_rewards_less_the_value(lengths, discount, seed):
    """The shaping telescopes: sum of γ^k A = G - V."""
    rng = np.random.default_rng(seed)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    rewards, value = rng.normal(size=(2, len(episode)))
    shaped = cumulative("to_go", advantage(rewards, value, episode, discount), episode, discount)
    returns = cumulative("to_go", rewards, episode, discount)
    np.testing.assert_allclose(shaped, returns - value, atol=1e-9)


def test_the_advantages_of_a_state_average_to_zero():
    """Over the rows of a state the mean of G - V is 0, whatever the episodes."""
    rng = np.random.default_rng(0)
    state, returns = rng.integers(4, size=200), rng.normal(size=200)
    value = mean_by_state(np.eye(4)[state], returns)
    for one in range(4):
        assert (returns - value)[state == one].mean() == pytest.approx(0.0, abs=1e-12)


def test_states_that_never_repeat_are_refused():
    with pytest.raises(UserError, match="use the target kind advantage_fitted"):
        mean_by_state(np.arange(3.0)[:, None], np.ones(3))
