import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize

from socialiq.mdp.solve import soft_value
from socialiq.theory import minimise as module
from socialiq.theory.minimise import Support, minimise


def test_a_symmetric_bandit_by_hand(bandit):
    """Both actions alike: π = 1/2, r̂ = m = 2/3, loss = 1/3 + τ log 2 per mass."""
    problem = bandit([0.5, 0.5], [1.0, 1.0], temperature=0.7)
    found = minimise(problem)
    np.testing.assert_allclose(found.policy, 0.5, rtol=1e-12)
    np.testing.assert_allclose(found.reward, 2 / 3, rtol=1e-9)
    assert found.loss == pytest.approx(0.1 * (1 / 3 + 0.7 * np.log(2)), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_general_method_finds_no_less(random_problem, seed):
    """BFGS with its own finite differences on `Problem.loss`, which Newton never calls."""
    problem = random_problem(seed, "to_go", strength=0.7, temperature=0.5)
    on = problem.support

    def loss(q_on: np.ndarray) -> float:
        q = np.full(on.shape, -np.inf)
        q[on] = q_on
        return problem.loss(q, soft_value(q, problem.temperature))

    # 1e4 makes finite differences of a loss of size 0.1 precise enough.
    general = minimize(lambda q: 1e4 * loss(q), np.zeros(on.sum()), options={"gtol": 1e-3})
    found = minimise(problem)
    assert found.loss <= general.fun / 1e4 + 1e-12
    np.testing.assert_allclose(found.q[on], general.x, atol=1e-4)
    assert found.loss == pytest.approx(loss(found.q[on]), rel=1e-12)


@pytest.mark.parametrize("temperature", [3.0, 1.0, 0.1, 1e-4])
def test_tables_fit_together(random_problem, temperature):
    problem = random_problem(1, temperature=temperature, strength=2.0)
    found, on = minimise(problem), problem.support
    assert found.residual < 1e-8
    assert np.isneginf(found.q[~on]).all() and np.isneginf(found.reward[~on]).all()
    assert (found.policy[~on] == 0).all() and (found.occupancy[~on] == 0).all()
    np.testing.assert_allclose(found.policy.sum(axis=1), 1.0)
    np.testing.assert_allclose(soft_value(found.q, temperature), found.v, rtol=1e-12, atol=1e-12)
    assert found.occupancy.sum() > 0.1


def test_a_start_leads_to_the_same_minimum_sooner(random_problem):
    problem = random_problem(2, temperature=1e-3)
    near = minimise(dataclasses.replace(problem, strength=1.02))
    cold, warm = minimise(problem), minimise(problem, near.q)
    np.testing.assert_allclose(warm.policy, cold.policy, atol=1e-6)
    assert warm.steps < cold.steps


def test_states_that_nobody_visits_get_an_even_policy(table7):
    from socialiq.evaluation.prediction import Setting, problem_of

    problem = problem_of(table7.reachable_part(), Setting())
    found = minimise(problem)
    unseen = ~problem.support.any(axis=1)
    assert unseen.sum() == 246
    np.testing.assert_array_equal(found.policy[unseen], 1 / 3)
    assert found.residual < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_newton_s_matrix_is_the_second_derivative_at_the_minimum(random_problem, seed):
    problem = random_problem(seed, temperature=0.8)
    support = Support(problem)
    q = minimise(problem).q[problem.support]

    def gradient(at: np.ndarray) -> np.ndarray:
        point = support.at(at, problem.temperature)
        pull = support.weight * support.slope(point.reward)
        through = support.entry - problem.discount * (support.flow.T @ pull)
        return pull + through[support.state] * point.pi

    steps = 1e-6 * np.eye(len(q))
    numeric = np.stack([(gradient(q + e) - gradient(q - e)) / 2e-6 for e in steps])
    point = support.at(q, problem.temperature)
    averages = support.averages(point.pi)
    occupancy = support.occupancy(point.pi, averages)
    matrix = module._curvature(support, averages, occupancy, problem.temperature)
    np.testing.assert_allclose(matrix, numeric, atol=1e-8)
