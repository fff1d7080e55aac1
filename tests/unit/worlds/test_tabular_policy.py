import numpy as np
import pytest

from socialiq.types import Policy
from socialiq.worlds.tabular_policy import TabularPolicy, draw_actions


@pytest.fixture
def policy(table5):
    chances = np.full((25, 2), 0.5)
    chances[table5.world.index((1, 2, 2, 3))] = [0.2, 0.8]
    return TabularPolicy(table5.world, chances)


def test_is_a_policy(policy):
    assert isinstance(policy, Policy)


def test_takes_the_likeliest_action_and_the_first_of_equals(policy):
    batch = np.array([[1, 2, 2, 3], [0, 2, 2, 0]], np.float32)
    actions, state = policy.predict(batch, state="kept")
    assert actions.tolist() == [1, 0]
    assert state == "kept"


def test_one_observation_gives_one_action(policy):
    action, _ = policy.predict(np.array([1, 2, 2, 3], np.float32))
    assert action.shape == ()
    assert action == 1


def test_draws_from_the_table(policy):
    batch = np.tile(np.array([1, 2, 2, 3], np.float32), (4000, 1))
    actions, _ = policy.predict(batch, deterministic=False)
    assert actions.mean() == pytest.approx(0.8, abs=4 * np.sqrt(0.16 / 4000))


def test_impossible_actions_are_never_drawn():
    chances = np.tile([[0.0, 0.5, 0.0, 0.5, 0.0]], (5000, 1))
    drawn = draw_actions(chances, np.random.default_rng(0))
    assert set(drawn) == {1, 3}


def test_rounding_of_the_sum_draws_no_action_beyond_the_last():
    class Highest(np.random.Generator):
        def random(self, shape):
            return np.full(shape, np.nextafter(1.0, 0.0))

    chances = np.full((1, 10), 0.1)
    assert chances.cumsum()[-1] < 1.0
    assert draw_actions(chances, Highest(np.random.PCG64())).tolist() == [9]
