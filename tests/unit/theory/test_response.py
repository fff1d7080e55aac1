import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.theory import response
from socialiq.theory.minimise import minimise


def test_a_bandit_by_hand(bandit):
    """π_2 = 0.3 (1 + 1.4 λ): half at λ = 0.476; π_1 = 0.7 (1 - 0.6 λ): gone at 1.667."""
    problem = bandit([0.7, 0.3], [0.0, 1.0])
    np.testing.assert_allclose(response.occupancy_slope(problem), [[-0.042, 0.042]], rtol=1e-12)
    assert response.target_slope(problem) == pytest.approx(0.042, rel=1e-12)
    lines = problem.demonstrated, response.occupancy_slope(problem)
    [flip] = response.flips(*lines)
    assert flip == (0, 0, 1, pytest.approx(0.4 / 0.84, rel=1e-12))
    assert response.reach(*lines) == pytest.approx(5 / 3, rel=1e-12)
    np.testing.assert_allclose(response.extinction(*_modes(), 1.0), [5 / 3, np.inf], rtol=1e-12)


def _modes() -> tuple[np.ndarray, np.ndarray]:
    return np.array([0.7, 0.3]), np.array([0.0, 1.0])


def test_the_bandit_does_so(bandit):
    """At τ = 1e-4 the exact minimum has the formulas' flips and extinctions, to 0.001."""
    problem = bandit([0.7, 0.3], [0.0, 1.0], temperature=1e-4)

    def second(strength: float) -> float:
        return minimise(dataclasses.replace(problem, strength=strength)).policy[0, 1]

    assert second(0.4757) < 0.5 < second(0.4767)
    assert second(1.66) < 1 - 1e-3 < second(1.68)


def test_the_weight_of_the_prior_moves_the_flip(bandit):
    problems = [bandit([0.7, 0.3], [0.0, 1.0], prior_weight=w) for w in (1.0, 0.5)]
    slopes = [response.occupancy_slope(problem) for problem in problems]
    lines = zip([problem.demonstrated for problem in problems], slopes, strict=True)
    strengths = [response.flips(*line)[0].strength for line in lines]
    assert strengths[1] == pytest.approx(2 * strengths[0], rel=1e-12)


def test_flips_by_hand():
    """Lines 5 - λ, 3 + λ, 1 + 2 λ: the second overtakes at 1; 2, 1 + λ, 1 + 2 λ: the third at 1/2.

    In the state between them the only gaining action is not demonstrated.
    """
    level = np.array([[5.0, 3.0, 1.0], [1.0, 0.5, 0.0], [2.0, 1.0, 1.0]])
    slope = np.array([[-1.0, 1.0, 2.0], [0.0, -1.0, 9.0], [0.0, 1.0, 2.0]])
    found = response.flips(level, slope)
    assert found[:2] == [(2, 0, 2, 0.5), (0, 0, 1, 1.0)]
    assert (found[2].state, found[2].strength) == (1, np.inf)


def test_a_state_without_a_choice_cannot_flip():
    assert response.flips(np.array([[1.0, 0.0]]), np.array([[-1.0, 1.0]])) == []


def test_reach_of_lines_that_never_fall():
    assert response.reach(np.array([[1.0, 0.0]]), np.array([[0.0, -1.0]])) == np.inf


def test_shares_that_are_none_are_refused():
    with pytest.raises(UserError, match="sum to 1"):
        response.extinction(np.array([0.5, 0.6]), np.zeros(2), 1.0)
