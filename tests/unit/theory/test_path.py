import numpy as np
import pytest

from socialiq.theory import response
from socialiq.theory.minimise import minimise
from socialiq.theory.response import first_flip, found_flips


def solve(problem, start):
    return minimise(problem, start).q


def test_a_bandit_s_flip_is_found(bandit):
    problem = bandit([0.7, 0.3], [0.0, 1.0], temperature=1e-4)
    [flip] = found_flips(problem, solve, [0.1, 0.3, 0.9])
    assert flip == (0, 0, 1, pytest.approx(0.4 / 0.84, rel=2e-3))


def test_the_first_flip_is_the_least_of_all(random_problem):
    problem, strengths = random_problem(0, temperature=0.05), [0.1, 0.3, 1.0, 3.0, 9.0]
    least = found_flips(problem, solve, strengths)[0].strength
    assert first_flip(problem, solve, strengths) == pytest.approx(least, rel=2e-3)
    assert first_flip(problem, solve, [1e-3]) == np.inf


def test_what_never_flips_is_infinite(bandit):
    [flip] = found_flips(bandit([0.7, 0.3], [1.0, 0.0]), solve, [1.0, 10.0])
    assert flip == (0, 0, 0, np.inf)


@pytest.mark.parametrize("seed", range(3))
def test_flips_within_reach_are_where_the_lines_cross(random_problem, seed):
    """τ = 1e-5 moves them by less than a hundredth."""
    problem = random_problem(seed, temperature=1e-5)
    lines = problem.demonstrated, response.occupancy_slope(problem)
    told = {f.state: f for f in response.flips(*lines)}
    reach = response.reach(*lines)
    strengths = (np.linspace(0.02, 1.0, 25) * reach).tolist()
    found = {f.state: f for f in found_flips(problem, solve, strengths)}
    for state, flip in told.items():
        if flip.strength < 0.98 * reach:
            assert found[state].strength == pytest.approx(flip.strength, rel=0.01)
            assert found[state].after == flip.after
        elif flip.strength > 1.02 * reach:
            assert found[state].strength == np.inf
