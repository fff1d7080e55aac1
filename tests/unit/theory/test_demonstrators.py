import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.mdp.solve import evaluate_policy
from socialiq.theory.demonstrators import TARGET_KINDS, mean_target, occupancies

SHARES = [0.5, 0.3, 0.2]


def pool(random_world, random_pool):
    mdp, policies = random_world(0), random_pool(0)
    return mdp, policies, occupancies(mdp, policies, SHARES, 0.9)


def test_parts_sum_to_the_mixture_s_flow(random_world, random_pool):
    mdp, _, parts = pool(random_world, random_pool)
    whole = parts.sum(axis=0)
    entered = whole.sum(axis=1) - 0.9 * mdp.arrivals(whole)
    np.testing.assert_allclose(entered, 0.1 * mdp.initial, atol=1e-15)


def test_one_demonstrator_s_to_go_is_its_q(random_world, random_pool):
    mdp, policies, _ = pool(random_world, random_pool)
    parts = occupancies(mdp, policies[:1], [1.0], 0.9)
    target = mean_target(mdp, policies[:1], parts, mdp.rewards.env, "to_go", 0.9)
    q = evaluate_policy(mdp, policies[0], mdp.rewards.env, 0.9).q
    np.testing.assert_allclose(target[parts[0] > 0], q[parts[0] > 0], rtol=1e-12)


def test_to_go_weighs_demonstrators_by_who_is_there(bandit):
    """Two modes with one-step episodes: each action's return is its own reward."""
    problem = bandit([0.5, 0.5], [1.0, 3.0])
    sure = [np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])]
    parts = occupancies(problem.mdp, sure, [0.25, 0.75], 0.9)
    np.testing.assert_allclose(parts.sum(axis=0), [[0.025, 0.075]], rtol=1e-12)
    to_go = mean_target(problem.mdp, sure, parts, problem.target, "to_go", 0.9)
    np.testing.assert_allclose(to_go, [[1.0, 3.0]])
    own = mean_target(problem.mdp, sure, parts, problem.target, "own_advantage", 0.9)
    np.testing.assert_array_equal(own, 0.0)  # each is as good as itself
    pooled = mean_target(problem.mdp, sure, parts, problem.target, "advantage", 0.9)
    np.testing.assert_allclose(pooled, [[-1.5, 0.5]])  # V of the pool is 2.5


@pytest.mark.parametrize("kind", ["running", "trajectory"])
def test_targets_that_know_the_past_are_refused(random_world, random_pool, kind):
    mdp, policies, parts = pool(random_world, random_pool)
    with pytest.raises(UserError, match="not a function of state and action"):
        mean_target(mdp, policies, parts, mdp.rewards.env, kind, 0.9)


def test_an_unknown_kind_is_refused(random_world, random_pool):
    mdp, policies, parts = pool(random_world, random_pool)
    with pytest.raises(UserError, match=", ".join(TARGET_KINDS)):
        mean_target(mdp, policies, parts, mdp.rewards.env, "hourly", 0.9)


@pytest.mark.parametrize("shares", [[0.5, 0.5], [0.5, 0.6, 0.1], [1.2, -0.1, -0.1]])
def test_shares_that_are_none_are_refused(random_world, random_pool, shares):
    with pytest.raises(UserError, match="one share for each of 3"):
        occupancies(random_world(0), random_pool(0), shares, 0.9)
