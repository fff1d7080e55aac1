import numpy as np
import pytest

from socialiq.theory.offline import conservative_loss, offset


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
