import numpy as np
import pytest

from socialiq.mdp.horizon import horizon_evaluation
from socialiq.social.angle import angle_of
from socialiq.types import Policy
from socialiq.worlds.tabular_policy import TabularPolicy, draw_actions, expert_policy


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


@pytest.mark.parametrize("variant", ["deterministic", "stochastic"])
@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0])
def test_experts_are_deterministic(angle, variant, table7):
    policy = expert_policy(table7, angle, variant)
    assert policy.shape == (12_096, 3)
    assert set(np.unique(policy)) == {0.0, 1.0}
    np.testing.assert_array_equal(policy.sum(axis=1), 1.0)


def test_the_reachable_part_has_the_same_experts(table7):
    kept = table7.mdp.reachable()
    whole = expert_policy(table7, 45.0)[kept]
    np.testing.assert_array_equal(whole, expert_policy(table7.reachable_part(), 45.0))


@pytest.mark.parametrize(("variant", "found"), [("deterministic", 13.49), ("stochastic", 167.64)])
def test_variants_differ_where_waiting_pays_only_by_chance(variant, found, tabulated):
    # no vehicle comes after the first, unless one spawns in the second slot
    table = tabulated("crossing7", first_slot="once").reachable_part()
    result = horizon_evaluation(table.mdp, expert_policy(table, 90.0, variant), 25)
    assert angle_of(*result.totals) == pytest.approx(found, abs=5e-3)


def test_an_expert_without_foresight_takes_the_best_step(table5):
    policy = expert_policy(table5, 0.0, discount=0.0)
    last_cell = table5.world.index((3, 2, 2, 0))
    np.testing.assert_array_equal(policy[last_cell], [0.0, 1.0])
    np.testing.assert_array_equal(policy[table5.world.index((0, 2, 2, 0))], [1.0, 0.0])
