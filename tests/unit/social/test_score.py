import numpy as np
import pytest

from socialiq.social.angle import exact_weights, weights
from socialiq.social.score import score
from socialiq.types import RewardPair


# r_env = 2, r_social = -4.
@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (0.0, 2.0),
        (30.0, -0.2679491924311226),  # 2 * 0.8660254 - 4 * 0.5
        (45.0, -1.4142135623730951),  # (2 - 4) / sqrt 2
        (90.0, -4.0),
        (180.0, -2.0),
        (270.0, 4.0),
    ],
)
def test_equation_4_3_by_hand(angle: float, expected: float) -> None:
    rewards = RewardPair(env=2.0, social=-4.0)
    assert score(exact_weights(angle), rewards) == pytest.approx(expected, abs=1e-14)


def test_equation_4_3_of_columns() -> None:
    rewards = RewardPair(env=np.array([1.0, 0.0, 3.0]), social=np.array([1.0, 2.0, -3.0]))
    root = np.sqrt(0.5)
    np.testing.assert_allclose(score(weights(45.0), rewards), [2 * root, 2 * root, 0.0], atol=1e-15)
