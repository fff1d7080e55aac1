import numpy as np
import pytest

from socialiq.mdp.horizon import horizon_evaluation
from socialiq.social.angle import angle_of
from socialiq.worlds.experts import expert_policy, without_chance


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


def test_without_chance_the_first_outcome_is_certain(table7):
    certain = without_chance(table7.mdp)
    assert (certain.probability == [1.0, 0.0]).all()
    np.testing.assert_array_equal(certain.successor, table7.mdp.successor)
    assert table7.mdp.probability[0, 0, 1] == 0.3


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
