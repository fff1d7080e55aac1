import dataclasses

import numpy as np
import pytest

from socialiq.mdp.solve import bellman_reward, soft_policy, soft_value
from socialiq.theory import response, semi_gradient
from socialiq.theory.closed_form import centre
from socialiq.theory.minimise import minimise


def test_without_a_successor_both_gradients_agree(bandit):
    problem = bandit([0.7, 0.3], [0.0, 1.0])
    np.testing.assert_allclose(semi_gradient.policy_slope(problem), [[-0.42, 0.42]], rtol=1e-12)
    q = semi_gradient.fixed_point(problem)
    np.testing.assert_allclose(q, minimise(problem).q, atol=1e-8)


def test_the_advantage_has_mean_zero(random_problem):
    problem = random_problem(0)
    policy = semi_gradient.demonstrated_policy(problem)
    mean = (policy * semi_gradient.pooled_advantage(problem)).sum(axis=1)
    np.testing.assert_allclose(mean, 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("temperature", [2.0, 1.0, 1e-3])
def test_the_fixed_point_fulfils_its_equation(random_problem, seed, temperature):
    problem = random_problem(seed, "to_go", strength=0.5, temperature=temperature)
    q = semi_gradient.fixed_point(problem)
    v, on = soft_value(q, temperature), problem.support
    share = semi_gradient.demonstrated_policy(problem)[on]
    push = (1.0 - soft_policy(q, temperature)[on] / share) / (2.0 * problem.curvature)
    reward = bellman_reward(problem.mdp, q, v, problem.discount)
    np.testing.assert_allclose(reward[on], centre(problem)[on] + push, atol=1e-8)


def test_descent_by_the_semi_gradient_ends_there(random_problem):
    """Descend with V(s') from the previous table, as with a target network."""
    problem = random_problem(0, strength=0.5)
    on = problem.support
    share, twice = semi_gradient.demonstrated_policy(problem)[on], 2.0 * problem.curvature
    q = np.where(on, 0.0, -np.inf)
    for _ in range(5000):
        reward = bellman_reward(problem.mdp, q, soft_value(q, 1.0), problem.discount)
        gap = reward[on] - centre(problem)[on]
        slope = soft_policy(q, 1.0)[on] - share + twice * share * gap
        # A step of its own for each pair: where it ends is the same at any pace.
        q[on] -= 0.03 * slope / share
    np.testing.assert_allclose(q[on], semi_gradient.fixed_point(problem)[on], atol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_the_lines_are_the_fixed_point_s_as_the_temperature_falls(random_problem, seed):
    """The entropy moves shares by some κτ; at τ = 1e-6 that is far below 1e-4."""
    problem = random_problem(seed, temperature=1e-6)
    level, slope = semi_gradient.demonstrated_policy(problem), semi_gradient.policy_slope(problem)
    strength = 0.9 * response.reach(level, slope)
    q = semi_gradient.fixed_point(dataclasses.replace(problem, strength=strength))
    found = soft_policy(q[problem.support.any(axis=1)], problem.temperature)
    expected = (level + strength * slope)[problem.support.any(axis=1)]
    np.testing.assert_allclose(found, expected, atol=1e-4)
