import numpy as np
import pytest

from socialiq.theory.primal import chi2_distance, dual_value, occupancy_entropy, primal_value


def test_chi2_by_hand(bandit):
    """(0.05 - 0.075)²/0.075 + (0.05 - 0.025)²/0.025 = 0.0333..."""
    problem = bandit([0.75, 0.25], [0.0, 0.0])
    assert chi2_distance(problem, np.array([[0.05, 0.05]])) == pytest.approx(1 / 30, rel=1e-12)


def test_chi2_of_what_nobody_shows_is_infinite(bandit):
    assert chi2_distance(bandit([1.0, 0.0], [0.0, 0.0]), np.array([[0.05, 0.05]])) == np.inf


def test_entropy_by_hand():
    """Mass 0.4 on even choices of two and 0.6 on a certain one: 0.4 log 2."""
    occupancy = np.array([[0.2, 0.2], [0.6, 0.0]])
    assert occupancy_entropy(occupancy) == pytest.approx(0.4 * np.log(2), rel=1e-12)


def test_the_primal_value_by_hand(bandit):
    """4 w λ E[T] - χ² + 4 κ τ H at the demonstrators' own occupancy, where χ² = 0."""
    problem = bandit([0.5, 0.5], [1.0, 3.0], strength=0.5, temperature=0.2)
    expected = 0.1 * (4 * 0.5 * 2.0 + 4 * 1.5 * 0.2 * np.log(2))
    assert primal_value(problem, problem.demonstrated) == pytest.approx(expected, rel=1e-12)


def test_the_dual_value_by_hand(bandit):
    """Even bandit with T = 1: loss 0.1 (1/3 + log 2), m = 2/3, constant of the square 1/3."""
    problem = bandit([0.5, 0.5], [1.0, 1.0])
    value = dual_value(problem, 0.1 * (1 / 3 + np.log(2)))
    assert value == pytest.approx(0.1 * 6.0 * (2 / 3 + np.log(2)), rel=1e-12)
    assert value == pytest.approx(primal_value(problem, problem.demonstrated), rel=1e-12)
