import numpy as np

from socialiq.theory.fixed_point import centre, closed_form


def test_the_centre_by_hand(bandit):
    """w λ T / (c + w) with c = 1/2, w = 1: two thirds of λ T."""
    problem = bandit([0.5, 0.5], [3.0, -6.0], strength=0.5)
    np.testing.assert_allclose(centre(problem), [[1.0, -2.0]], rtol=1e-12)


def test_the_closed_form_by_hand(bandit):
    """κ = 3/2: an action never taken has m + 1/3, one taken twice as often m - 1/3."""
    problem = bandit([0.5, 0.25, 0.25], [0.0, 3.0, 0.0])
    found = closed_form(problem, 0.1 * np.array([[0.5, 0.0, 0.5]]))
    np.testing.assert_allclose(found, [[0.0, 2.0 + 1 / 3, -1 / 3]], atol=1e-12)


def test_what_nobody_shows_has_no_reward(bandit):
    found = closed_form(bandit([1.0, 0.0], [0.0, 5.0]), np.array([[0.1, 0.0]]))
    assert abs(found[0, 0]) < 1e-12 and np.isneginf(found[0, 1])
