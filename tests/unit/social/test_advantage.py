import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialiq.errors import UserError
from socialiq.social.advantage import advantage, mean_by_state
from socialiq.social.returns import cumulative

# Two episodes from state A at discount 1/2: A -1-> B -4-> end, and A -3-> end.
REWARDS, EPISODE = np.array([1.0, 4.0, 3.0]), np.array([0, 0, 1])
OBSERVATION = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])


def test_advantages_by_hand() -> None:
    """G = 3, 4, 3; V(A) = 3 and V(B) = 4; A = 1 + 4/2 - 3, 4 - 4, 3 - 3."""
    value = mean_by_state(OBSERVATION, cumulative("to_go", REWARDS, EPISODE, 0.5))
    np.testing.assert_array_equal(value, [3.0, 4.0, 3.0])
    np.testing.assert_array_equal(advantage(REWARDS, value, EPISODE, 0.5), [0.0, 0.0, 0.0])


def test_a_step_that_turned_out_better_than_usual() -> None:
    """With 5 in place of 3, V(A) = (3 + 5) / 2: the first way is one worse, the second better."""
    rewards = np.array([1.0, 4.0, 5.0])
    value = mean_by_state(OBSERVATION, cumulative("to_go", rewards, EPISODE, 0.5))
    np.testing.assert_array_equal(value, [4.0, 4.0, 4.0])
    np.testing.assert_array_equal(advantage(rewards, value, EPISODE, 0.5), [-1.0, 0.0, 1.0])


@given(st.lists(st.integers(1, 6), min_size=1, max_size=5), st.floats(0, 1), st.integers(0, 99))
def test_its_returns_to_go_are_those_of_the_rewards_less_the_value(
    lengths: list[int], discount: float, seed: int
) -> None:
    """The shaping telescopes: sum of γ^k A = G - V."""
    rng = np.random.default_rng(seed)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    rewards, value = rng.normal(size=(2, len(episode)))
    shaped = cumulative("to_go", advantage(rewards, value, episode, discount), episode, discount)
    returns = cumulative("to_go", rewards, episode, discount)
    np.testing.assert_allclose(shaped, returns - value, atol=1e-9)


def test_the_advantages_of_a_state_average_to_zero() -> None:
    """Over the rows of a state the mean of G - V is 0, whatever the episodes."""
    rng = np.random.default_rng(0)
    state, returns = rng.integers(4, size=200), rng.normal(size=200)
    value = mean_by_state(np.eye(4)[state], returns)
    for one in range(4):
        assert (returns - value)[state == one].mean() == pytest.approx(0.0, abs=1e-12)


def test_states_that_never_repeat_are_refused() -> None:
    with pytest.raises(UserError, match="use the target kind advantage_fitted"):
        mean_by_state(np.arange(3.0)[:, None], np.ones(3))
