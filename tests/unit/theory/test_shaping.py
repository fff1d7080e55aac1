import numpy as np
import pytest

from socialiq.theory.objective import orthogonal, shaped


def test_shaping_by_hand(bandit):
    """All actions end, so that only -Φ(s) is left."""
    problem = bandit([0.5, 0.5], [1.0, 2.0])
    found = shaped(problem.mdp, problem.target, np.array([0.5]), 0.9)
    np.testing.assert_allclose(found, [[0.5, 1.5]])


def test_without_a_successor_the_mean_is_taken_off(bandit):
    """T_⊥ = T - E[T] in a bandit; its squared norm is the variance times the mass."""
    problem = bandit([0.7, 0.3], [0.0, 1.0])
    found = orthogonal(problem.mdp, problem.demonstrated, problem.target, 0.9)
    np.testing.assert_allclose(found.target, [[-0.3, 0.7]], rtol=1e-12)
    assert found.norm**2 == pytest.approx(0.1 * 0.21, rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_left_carries_no_flow(random_problem, seed):
    problem = random_problem(seed)
    found = orthogonal(problem.mdp, problem.demonstrated, problem.target, problem.discount)
    move = problem.demonstrated * found.target
    entered = move.sum(axis=1) - problem.discount * problem.mdp.arrivals(move)
    np.testing.assert_allclose(entered, 0.0, atol=1e-14)
    again = shaped(problem.mdp, problem.target, found.potential, problem.discount)
    on = problem.support
    np.testing.assert_allclose(again[on], found.target[on], atol=1e-12)


def test_pure_shaping_leaves_nothing(random_problem):
    problem = random_problem(0)
    potential = np.random.default_rng(0).normal(size=6)
    pure = shaped(problem.mdp, np.zeros((6, 3)), potential, problem.discount)
    found = orthogonal(problem.mdp, problem.demonstrated, pure, problem.discount)
    assert found.norm == 0.0 and not found.target.any()
