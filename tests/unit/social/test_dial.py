import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.mdp.front import AttainableSet
from socialiq.social.angle import angle_of
from socialiq.social.dial import mixed_angle, mixture, setting

CORNERS = np.array([[2.0, 0.0], [0.0, 2.0]])


def test_halfway_between_two_policies():
    found = setting(CORNERS, 45.0)
    assert {found.first, found.second} == {0, 1}
    assert found.share == pytest.approx(0.5)
    assert found.radius == pytest.approx(2**0.5)


def test_a_third_of_the_way():
    """(1 - p) (2, 0) + p (0, 2) lies at atan(1/2) for p = 1/3."""
    angle = float(np.degrees(np.arctan2(1.0, 2.0)))
    found = setting(CORNERS, angle)
    share = found.share if found.first == 0 else 1.0 - found.share
    assert share == pytest.approx(1 / 3)
    assert found.radius == pytest.approx(np.hypot(4 / 3, 2 / 3))


def test_of_mixtures_at_one_angle_the_longest_is_taken():
    points = np.array([[1.0, 0.0], [0.0, 1.0], [3.0, 0.0], [0.0, 3.0]])
    found = setting(points, 45.0)
    assert {found.first, found.second} == {2, 3}


def test_a_policy_that_has_the_angle_by_itself_may_be_taken_alone():
    found = setting(np.array([[1.0, 1.0], [0.5, 0.0], [0.0, 0.5]]), 45.0)
    np.testing.assert_allclose(mixture(np.array([[1.0, 1.0], [0.5, 0], [0, 0.5]]), found), [1, 1])
    assert found.radius == pytest.approx(2**0.5)


@pytest.mark.parametrize("seed", range(5))
def test_no_mixture_of_any_number_is_longer(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(6, 2)) + 0.5
    from scipy.spatial import ConvexHull

    hull = AttainableSet(points[ConvexHull(points).vertices])
    for angle in rng.uniform(-180, 180, 50):
        try:
            longest = hull.radius(angle)
        except UserError:
            with pytest.raises(UserError, match="no mixture"):
                setting(points, angle)
            continue
        found = setting(points, angle)
        assert found.radius == pytest.approx(longest, abs=1e-9)
        if found.radius > 1e-6:
            assert angle_of(*mixture(points, found)) == pytest.approx(angle, abs=1e-6)


def test_an_angle_out_of_reach_is_said():
    with pytest.raises(UserError, match="no mixture of these policies lies at 180 degrees"):
        setting(CORNERS, 180.0)


def test_the_interval_of_a_mixture_covers_as_it_says():
    """Of 200 intervals of 90 %, 180 are expected to hold the true angle; 3 sd are 12.7."""
    rng = np.random.default_rng(0)
    inside = 0
    for seed in range(200):
        first = rng.normal((2.0, 0.0), 1.0, (100, 2))
        second = rng.normal((0.0, 2.0), 2.0, (100, 2))
        found = mixed_angle(first, second, 0.5, seed, confidence=0.9, resamples=400)
        inside += found.low <= 45.0 <= found.high
    assert 167 <= inside <= 193


def test_a_mixture_without_episodes_has_no_angle():
    with pytest.raises(UserError, match="at least one episode"):
        mixed_angle(np.ones((1, 2)), np.ones((0, 2)), 0.5, 0)
