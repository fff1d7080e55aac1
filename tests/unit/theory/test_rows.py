import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.rollout import MODES, demonstrations_by_mode
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.theory.demonstrators import drawn_rows, with_cuts
from socialiq.theory.objective import Problem
from socialiq.worlds.tabular_policy import expert_policy

SHARES = [0.5, 0.3, 0.2]


def drawn(random_world, random_pool, kind="to_go", horizon=7):
    mdp, policies = random_world(0), random_pool(0)
    return drawn_rows(mdp, policies, SHARES, mdp.rewards.env, kind, horizon, 0.9)


def test_shares_are_the_visits_of_an_episode(random_world, random_pool):
    mdp, policies = random_world(0), random_pool(0)
    visits = sum(
        share * horizon_evaluation(mdp, policy, 7).visits
        for share, policy in zip(SHARES, policies, strict=True)
    )
    found = drawn(random_world, random_pool)
    np.testing.assert_allclose(found.shares, visits / visits.sum(), rtol=1e-12)


@pytest.mark.parametrize("horizon", [1, 3, 40])
def test_rows_are_an_occupancy_of_the_other_mdp(random_world, random_pool, horizon):
    """`Problem` refuses a measure that is not an occupancy."""
    found = drawn(random_world, random_pool, horizon=horizon)
    problem = Problem(found.mdp, found.shares, found.target, discount=0.9)
    assert problem.discount == 0.9 and problem.mdp is found.mdp


def test_after_one_step_the_clock_cuts_everything(random_world, random_pool):
    mdp = random_world(0)
    found = drawn(random_world, random_pool, horizon=1)
    np.testing.assert_allclose(found.mdp.ending_probability[found.shares > 0, 0], 0.0)
    on = found.shares > 0
    np.testing.assert_allclose(found.target[on], mdp.rewards.env[on])


def test_cuts_by_hand(bandit):
    mdp = with_cuts(bandit([0.5, 0.5], [0.0, 0.0]).mdp, np.array([[0.25, 1.0]]))
    np.testing.assert_allclose(mdp.probability, [[[0.75, 0.25], [0.0, 1.0]]])


def test_recorded_episodes_agree(table7):
    """400 episodes of each expert: shares and mean returns-to-go within four standard errors."""
    part = table7.reachable_part()
    policies = [expert_policy(part, angle) for angle in MODES.values()]
    found = drawn_rows(part.mdp, policies, [1 / 3] * 3, part.mdp.rewards.env, "to_go", 25, 0.99)
    pools = demonstrations_by_mode(table7, dict.fromkeys(MODES, 400), seed=5)
    world, place = table7.world, {int(table7.world.index(s)): i for i, s in enumerate(part.states)}
    counts, earned = np.zeros(found.shares.shape), np.zeros(found.shares.shape)
    for data in pools.values():
        states = [place[int(i)] for i in world.index(data.observation.astype(int))]
        np.add.at(counts, (states, data.action), 1.0)
        np.add.at(earned, (states, data.action), data.returns("to_go", 0.99).env)
    often = counts > 300
    assert often.sum() > 10
    np.testing.assert_allclose(counts[often] / counts.sum(), found.shares[often], rtol=0.15)
    mean = earned[often] / counts[often]
    np.testing.assert_allclose(mean, found.target[often], rtol=0.1, atol=0.05)


@pytest.mark.parametrize("kind", ["advantage", "running"])
def test_targets_that_rows_do_not_carry_are_refused(random_world, random_pool, kind):
    with pytest.raises(UserError, match="choose"):
        drawn(random_world, random_pool, kind)
