import dataclasses
import math

import numpy as np
import pytest

from socialiq.errors import UserError


def test_loss_of_a_bandit_by_hand(bandit):
    """r̂ = Q: -E[r̂] + V + c E[r̂²] + w E[(r̂ - λT)²], over the mass 1 - γ."""
    problem = bandit([0.75, 0.25], [0.0, 2.0], strength=0.5, temperature=0.5)
    q, v = np.array([[1.0, 2.0]]), np.array([3.0])
    by_hand = -1.25 + 3.0 + 0.5 * (0.75 + 0.25 * 4) + 0.75 * 1.0 + 0.25 * (2.0 - 1.0) ** 2
    assert problem.loss(q, v) == pytest.approx(0.1 * by_hand, rel=1e-12)


def test_coefficients_by_hand(bandit):
    problem = bandit([1.0], [0.0], chi2_alpha=0.25, prior_weight=2.0)
    assert (problem.chi2_coefficient, problem.curvature) == (1.0, 3.0)


def test_the_scale_of_the_demonstrations_is_free(random_problem):
    problem = random_problem(0)
    larger = dataclasses.replace(problem, demonstrated=7.0 * problem.demonstrated)
    q, v = np.zeros(problem.support.shape), np.full(6, 0.3)
    assert larger.loss(q, v) == pytest.approx(7.0 * problem.loss(q, v), rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"strength": -1.0}, "strength must be 0 or more"),
        ({"prior_weight": math.nan}, "prior_weight must be 0 or more"),
        ({"temperature": 0.0}, "temperature must be above 0"),
        ({"chi2_alpha": -0.5}, "chi2_alpha must be above 0"),
        ({"discount": 1.0}, "discount must lie in"),
        ({"target": np.full((6, 3), np.inf)}, "target must be finite"),
        ({"demonstrated": np.ones((6, 3))}, "not an occupancy of the MDP"),
        ({"demonstrated": np.zeros((6, 3))}, "some positive one"),
    ],
)
def test_what_makes_no_problem_is_refused(random_problem, changes, line):
    with pytest.raises(UserError, match=line):
        dataclasses.replace(random_problem(0), **changes)


def test_the_occupancy_of_another_discount_is_refused(random_problem):
    with pytest.raises(UserError, match="flow is off"):
        dataclasses.replace(random_problem(0), discount=0.8)
