"""Two drivers who move at the same time, and the norms that follow."""

import math
from functools import cache

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.population import norms
from socialiq.population.crossing_game import STARTS, CrossingGame
from socialiq.population.equilibrium import logit_equilibrium

ANGLES = (0.0, 15.0, 30.0, 60.0)


@pytest.fixture(scope="module")
def payoffs():
    return CrossingGame().payoffs(ANGLES)


def answer(payoffs, chances, temperature):
    scores = np.einsum("gab,gb->ga", payoffs, chances) / temperature
    weights = np.exp(scores - scores.max(axis=1, keepdims=True))
    return weights / weights.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("temperature", [1.0, 0.05])
def test_each_answers_the_other(temperature):
    first, second = np.random.default_rng(0).normal(0.0, 2.0, (2, 200, 3, 3))
    chances = logit_equilibrium(first, second, temperature)
    np.testing.assert_allclose(chances.first, answer(first, chances.second, temperature), atol=1e-9)
    turned = second.transpose(0, 2, 1)
    np.testing.assert_allclose(
        chances.second, answer(turned, chances.first, temperature), atol=1e-9
    )


def test_a_dominant_action_is_drawn_from_a_softmax():
    """Payoffs that do not depend on the other have one equilibrium, in closed form."""
    own = np.array([0.0, 0.3, 0.1])
    alone = np.broadcast_to(own[:, None], (1, 3, 3)).copy()
    chances = logit_equilibrium(alone, alone.transpose(0, 2, 1).copy(), 0.2)
    softmax = np.exp(own / 0.2) / np.exp(own / 0.2).sum()
    np.testing.assert_allclose(chances.first[0], softmax, atol=1e-12)
    np.testing.assert_allclose(chances.second[0], softmax, atol=1e-12)


def test_equals_behave_equally_in_a_game_with_three_equilibria():
    """In the game of chicken near τ = 0 the chance to go tends to that of the mixed equilibrium."""
    first = np.array([[[0.0, 1.0], [3.0, -5.0]]])
    for temperature, distance in ((0.05, 0.01), (0.005, 0.001)):
        chances = logit_equilibrium(first, first.transpose(0, 2, 1), temperature)
        np.testing.assert_allclose(chances.first, chances.second, atol=1e-12)
        # 0 · p + 1 · (1 - p) = 3 p - 5 (1 - p) at p = 2/3, the chance of the first action
        assert abs(chances.first[0, 0] - 2 / 3) < distance


def test_roles_do_not_matter(payoffs):
    """Without an exact symmetry rounding chose a leader, and the diagonal was one-sided."""
    finer = CrossingGame(temperature=0.2)
    both = finer.payoffs((30.0, 60.0)).r_env
    swapped = finer.payoffs((60.0, 30.0)).r_env
    np.testing.assert_allclose(both, swapped[::-1, ::-1], atol=1e-12)
    assert (np.diagonal(payoffs.collision) > 1e-3).all()  # equals have no convention
    others = payoffs.collision[~np.eye(len(ANGLES), dtype=bool)]
    assert others.min() < 1e-9


def test_other_code_gives_the_same_payoffs():
    """A recursion over states by plain numbers, at a τ with one equilibrium."""
    temperature, horizon, angles = 5.0, 4, (0.0, 60.0)
    weights = [(math.cos(math.radians(angle)), math.sin(math.radians(angle))) for angle in angles]

    def rewards(x, y, a, b):
        after = min(x + a, 6), min(y + b, 6)
        enters = [
            before < 6 and (end == 3 or before < 3 <= end)
            for before, end in zip((x, y), after, strict=True)
        ]
        if all(enters):
            return (-5.0, -5.0), after, True
        pair = tuple(
            0.0 if before == 6 else 2.0 if end == 6 else 0.2 * action - 0.3
            for before, end, action in zip((x, y), after, (a, b), strict=True)
        )
        return pair, after, after == (6, 6)

    @cache
    def value(x, y, left, i, j):
        if left == 0:
            return 0.0, 0.0
        sums = {}
        for a in range(3):
            for b in range(3):
                pair, after, over = rewards(x, y, a, b)
                rest = (0.0, 0.0) if over else value(*after, left - 1, i, j)
                sums[a, b] = pair[0] + rest[0], pair[1] + rest[1]
        p, q = [1 / 3] * 3, [1 / 3] * 3
        for _ in range(400):
            scores = [
                [sum(q[b] * (weights[i][0] * sums[a, b][0] + weights[i][1] * sums[a, b][1])
                     for b in range(3)) for a in range(3)],
                [sum(p[a] * (weights[j][0] * sums[a, b][1] + weights[j][1] * sums[a, b][0])
                     for a in range(3)) for b in range(3)],
            ]  # fmt: skip
            for chances, row in zip((p, q), scores, strict=True):
                total = sum(math.exp(score / temperature) for score in row)
                for action, score in enumerate(row):  # half a step, or the answers would swing
                    chances[action] += (math.exp(score / temperature) / total - chances[action]) / 2
        outcomes = [(p[a] * q[b], sums[a, b]) for a in range(3) for b in range(3)]
        return (
            sum(chance * pair[0] for chance, pair in outcomes),
            sum(chance * pair[1] for chance, pair in outcomes),
        )

    expected = [
        [np.mean([value(*start, horizon, i, j)[0] for start in STARTS]) for j in (0, 1)]
        for i in (0, 1)
    ]
    fresh = CrossingGame(temperature, horizon).payoffs(angles)
    np.testing.assert_allclose(fresh.r_env, expected, atol=1e-9)


def test_no_angle_is_stable_alone(payoffs):
    """Drivers that differ from all others have the way or give it, and equals draw lots."""
    assert not norms.stable_angles(payoffs.r_env).any()
    fitness = norms.invasion_fitness(payoffs.r_env)
    assert fitness[1, 0] > 0.02
    assert fitness[0, 1] > 0.08
    rest = norms.mandate(payoffs.r_env, ANGLES, 0.0)
    assert rest.shares[0, 0] > 0.7
    assert rest.shares[0, 1] > 0.2


def test_a_mandate_moves_the_rest_point(payoffs):
    obeyed = norms.mandate(payoffs.r_env, ANGLES, 30.0)
    assert obeyed.shares[:, :2].sum() == 0.0
    half = norms.mandate(payoffs.r_env, ANGLES, 30.0, obeyed=0.5)
    assert half.shares.sum(axis=1) == pytest.approx([0.5, 0.5])
    assert half.shares[0, :2].sum() == 0.0
    assert half.payoffs[1] > half.payoffs[0]  # who does not obey gains


@pytest.mark.parametrize(
    ("matrix", "stable"),
    [
        ([[3.0, 0.0], [5.0, 1.0]], [False, True]),  # prisoner's dilemma
        ([[-1.0, 2.0], [0.0, 1.0]], [False, False]),  # hawk and dove, V = 2, C = 4
        ([[2.0, 0.0], [0.0, 1.0]], [True, True]),  # coordination
        ([[1.0, 1.0], [1.0, 1.0]], [False, False]),  # neutral: drift
        ([[1.0, 2.0], [1.0, 1.0]], [True, False]),  # a tie that the second condition decides
    ],
)
def test_stable_angles_of_known_games(matrix, stable):
    assert norms.stable_angles(np.array(matrix)).tolist() == stable


def test_rest_point_of_hawks_and_doves_is_known():
    matrix = np.array([[-1.0, 2.0], [0.0, 1.0]])
    rest = norms.rest_point(matrix, np.ones((1, 2), dtype=bool), [1.0])
    np.testing.assert_allclose(rest.shares, [[0.5, 0.5]], atol=1e-4)
    assert rest.payoffs[0] == pytest.approx(0.5, abs=1e-4)


def test_mistakes_are_one_line(payoffs):
    with pytest.raises(UserError, match="temperature 0 is not positive"):
        CrossingGame(temperature=0.0).payoffs((0.0,))
    with pytest.raises(UserError, match="horizon 0 must be at least 1"):
        CrossingGame(horizon=0).payoffs((0.0,))
    with pytest.raises(UserError, match="lower the minimum"):
        norms.mandate(payoffs.r_env, ANGLES, 91.0)
    with pytest.raises(UserError, match="share 2"):
        norms.mandate(payoffs.r_env, ANGLES, 30.0, obeyed=2.0)
    cycle = np.array([[0.0, -1.0, 1.5], [1.5, 0.0, -1.0], [-1.0, 1.5, 0.0]]) * -1
    with pytest.raises(UserError, match="cycle"):
        norms.rest_point(cycle + np.diag([0.0, 0.1, 0.2]), np.ones((1, 3), dtype=bool), [1.0])
