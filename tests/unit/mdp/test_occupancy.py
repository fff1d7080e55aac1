import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.mdp.occupancy import discounted_occupancy


def test_occupancy_by_hand(small_road):
    policy = np.array([[0.5, 0.5], [0.0, 1.0], [1.0, 0.0]])
    # Visits to 0: 1 / (1 - .8 * .5); to 1: .8 * .5 * .75 of those; to 2: none.
    first = 1 / 0.6
    expected = 0.2 * np.array([[first / 2, first / 2], [0.0, 0.3 * first], [0.0, 0.0]])
    found = discounted_occupancy(small_road, policy, 0.8)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=0)


def test_discount_zero_is_the_first_step(random_mdp, random_policy):
    rng = np.random.default_rng(0)
    mdp, policy = random_mdp(rng, 5, 2, 2, 0.2), random_policy(rng, 5, 2)
    found = discounted_occupancy(mdp, policy, 0.0)
    np.testing.assert_allclose(found, mdp.initial[:, None] * policy, rtol=1e-14)


def test_mistakes_are_refused(small_road):
    uniform = np.full((3, 2), 0.5)
    for discount in (1.0, -0.1, np.nan):
        with pytest.raises(UserError, match=r"outside \[0, 1\)"):
            discounted_occupancy(small_road, uniform, discount)
    with pytest.raises(UserError, match="sum to 1"):
        discounted_occupancy(small_road, uniform / 2, 0.9)
