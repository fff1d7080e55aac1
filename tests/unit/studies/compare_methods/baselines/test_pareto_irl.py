import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from socialiq.social.angle import score, weights
from socialiq.types import RewardPair
from studies.compare_methods.baselines.online import Inferred, inferred_reward, inferring


def test_the_inferred_reward_by_hand(constant, rows_of):
    """Q = (1, 3), γ = 0.5, τ = 2: V = 2 ln(e^0.5 + e^1.5); 0 follows an end."""
    reward = Inferred(constant(1.0, 3.0), 2.0, 0.5)
    other = Inferred(constant(0.0, 0.0), 1.0, 0.5)
    value = 2 * np.log(np.exp(0.5) + np.exp(1.5))
    rows = rows_of([1], [7.0], ending=0)
    assert inferred_reward(*reward, rows)[0] == pytest.approx(3 - 0.5 * value, rel=1e-5)
    assert inferred_reward(*other, rows)[0] == pytest.approx(-0.5 * np.log(2), rel=1e-5)
    ended = inferring(lambda _act, _rng: rows_of([0], [7.0]), (reward, other))
    pair = ended(lambda one: one, np.random.default_rng(0)).target
    assert (float(pair.env[0]), float(pair.social[0])) == pytest.approx((1.0, 0.0))


@pytest.mark.parametrize("angle", [15.0, 45.0, 80.0])
def test_the_score_is_the_reward_of_least_weighted_distance(angle):
    """argmin_r w_1 (r - r_1)² + w_2 (r - r_2)², but for the factor 1 / (w_1 + w_2)."""
    pair, direction = RewardPair(1.3, -0.4), weights(angle)

    def distance(reward: np.ndarray) -> float:
        gaps = (reward[0] - pair.env) ** 2, (reward[0] - pair.social) ** 2
        return float(direction.env * gaps[0] + direction.social * gaps[1])

    least = minimize(distance, [0.0], tol=1e-10).x[0]
    scaled = score(direction, pair) / (direction.env + direction.social)
    assert least == pytest.approx(float(jnp.asarray(scaled)), abs=1e-4)
