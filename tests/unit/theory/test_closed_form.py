import numpy as np
import pytest

from socialiq.theory.closed_form import (
    centre,
    chi2_distance,
    closed_form,
    conservative_loss,
    dual_value,
    occupancy_entropy,
    offset,
    primal_value,
)


def test_the_centre_by_hand(bandit):
    """w λ T / (c + w) with c = 1/2, w = 1: two thirds of λ T."""
    problem = bandit([0.5, 0.5], [3.0, -6.0], strength=0.5)
    np.testing.assert_allclose(centre(problem), [[1.0, -2.0]], rtol=1e-12)


def test_the_closed_form_by_hand(bandit):
    """κ = 3/2: an action never taken has m + 1/3, one taken twice as often m - 1/3."""
    problem = bandit([0.5, 0.25, 0.25], [0.0, 3.0, 0.0])
    found = closed_form(problem, 0.1 * np.array([[0.5, 0.0, 0.5]]))
    np.testing.assert_allclose(found, [[0.0, 2.0 + 1 / 3, -1 / 3]], atol=1e-12)


def test_pairs_without_demonstrations_have_no_reward(bandit):
    found = closed_form(bandit([1.0, 0.0], [0.0, 5.0]), np.array([[0.1, 0.0]]))
    assert abs(found[0, 0]) < 1e-12 and np.isneginf(found[0, 1])


def test_conservative_q_learning_by_hand(bandit):
    """m = (0, 2), Q = (1, 2), V = 3: surprise 2 and 1, squares 1 and 0, κ = 3/2."""
    problem = bandit([0.75, 0.25], [0.0, 3.0])
    q, v = np.array([[1.0, 2.0]]), np.array([3.0])
    by_hand = 0.75 * 2 + 0.25 * 1 + 1.5 * 0.75
    assert conservative_loss(problem, q, v) == pytest.approx(0.1 * by_hand, rel=1e-12)


def test_the_constant_by_hand(bandit):
    """(c w / κ) λ² E[T²] = (1/3) 4 · 0.25 · 9."""
    problem = bandit([0.75, 0.25], [0.0, 3.0], strength=2.0)
    assert offset(problem) == pytest.approx(0.1 * 3.0, rel=1e-12)


def test_chi2_by_hand(bandit):
    """(0.05 - 0.075)²/0.075 + (0.05 - 0.025)²/0.025 = 0.0333..."""
    problem = bandit([0.75, 0.25], [0.0, 0.0])
    assert chi2_distance(problem, np.array([[0.05, 0.05]])) == pytest.approx(1 / 30, rel=1e-12)


def test_chi2_outside_the_demonstrations_is_infinite(bandit):
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
