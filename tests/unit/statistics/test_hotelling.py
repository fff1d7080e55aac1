import numpy as np
import pytest
from scipy.stats import f

from socialiq.statistics.hotelling import confidence_ellipse


def scaled(mean, episodes=102):
    """Totals with a given mean and, to rounding, covariance diag(4, 1)."""
    rng = np.random.default_rng(0)
    raw = rng.normal(size=(episodes, 2))
    raw -= raw.mean(axis=0)
    whitened = raw @ np.linalg.inv(np.linalg.cholesky(np.cov(raw.T))).T
    return whitened * [2.0, 1.0] + mean


def test_the_half_axes_by_hand():
    found = confidence_ellipse(scaled([3.0, 1.0]))
    # 2 (n - 1) / (n - 2) F / n at n = 102
    limit = 2 * 101 / 100 * f.ppf(0.95, 2, 100) / 102
    assert (found.major, found.minor) == pytest.approx((2 * limit**0.5, limit**0.5))
    assert (found.env, found.social) == pytest.approx((3.0, 1.0))
    assert abs(found.tilt) < 1e-6 and not found.holds_origin


@pytest.mark.parametrize("axis", [0, 1])
def test_the_origin_at_the_rim(axis):
    rim = np.zeros(2)
    half = (2 * 101 / 100 * f.ppf(0.95, 2, 100) / 102) ** 0.5 * (2.0, 1.0)[axis]
    for share, inside in ((0.99, True), (1.01, False), (-0.99, True)):
        rim[axis] = share * half
        assert confidence_ellipse(scaled(rim)).holds_origin is inside


def test_the_tilt_is_of_the_longer_axis():
    turn = np.deg2rad(30.0)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    assert confidence_ellipse(scaled([0.0, 0.0]) @ rotation.T).tilt == pytest.approx(30.0)
    upright = confidence_ellipse(scaled([0.0, 0.0])[:, ::-1])
    assert abs(upright.tilt) == pytest.approx(90.0)


def test_what_does_not_vary_has_a_direction_unless_it_is_nothing():
    assert not confidence_ellipse(np.full((10, 2), [5.0, -4.0])).holds_origin
    assert confidence_ellipse(np.zeros((10, 2))).holds_origin
    line = np.zeros((50, 2))
    line[:, 0] = np.random.default_rng(0).normal(size=50)
    assert confidence_ellipse(line).holds_origin
    assert not confidence_ellipse(line + np.array([0.0, 0.1])).holds_origin
    assert confidence_ellipse(line).minor == 0.0


def test_the_thesis_altruist_needs_episodes():
    """Means of 100 episodes with its spreads tell no direction; of 10,000 they do."""
    rng = np.random.default_rng(1)
    totals = rng.normal([0.0, 0.2], [1.0, 1.0], (10_000, 2))
    assert (
        confidence_ellipse(totals[:100]).holds_origin
        and not confidence_ellipse(totals).holds_origin
    )
