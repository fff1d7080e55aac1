"""Displacements on an arc, levels of acceleration, and errors that are left."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.decisions import displacement, levels_of, wrapped_difference


def at(speed, acceleration, curvature, seconds):
    each = (np.array([value], np.float64) for value in (speed, acceleration, curvature, seconds))
    ahead, beside = displacement(*each)
    return float(ahead[0]), float(beside[0])


def test_straight_ahead_is_school_kinematics():
    assert at(10.0, 2.0, 0.0, 1.0) == pytest.approx((11.0, 0.0))
    assert at(10.0, -4.0, 0.0, 2.0) == pytest.approx((12.0, 0.0))


def test_a_vehicle_that_stops_stays():
    # 4 m/s at -2 m/s²: at rest after 2 s and 4 m, also 8 s later.
    assert at(4.0, -2.0, 0.0, 10.0) == pytest.approx((4.0, 0.0))


def test_a_quarter_circle_ends_a_radius_ahead_and_a_radius_to_the_left():
    radius = 20.0
    seconds = np.pi / 2 * radius / 5.0
    assert at(5.0, 0.0, 1 / radius, seconds) == pytest.approx((20.0, 20.0))
    assert at(5.0, 0.0, -1 / radius, seconds) == pytest.approx((20.0, -20.0))


def test_a_turn_over_the_back_is_short():
    found = wrapped_difference(np.array([3.1, -3.1]), np.array([-3.1, 3.1]))
    assert found == pytest.approx([2 * np.pi - 6.2, 6.2 - 2 * np.pi])


def test_levels_take_the_closest_and_a_tie_the_gentler():
    found = levels_of(np.array([5.0, 5.4, 6.9, 5.4, 2.0]), (-2.0, -1.0, 0.0, 1.0, 2.0), 1.0)
    assert found.action.tolist() == [2, 3, 1, 0]
    assert found.residual == pytest.approx([0.4, 0.5, -0.5, -1.4])
    half = levels_of(np.array([5.0, 5.4]), (-1.0, 0.0, 1.0), 0.5)
    assert half.action.tolist() == [2] and half.residual == pytest.approx([-0.1])


def test_levels_are_an_option_that_leaves_the_default():
    assert EpisodeConfig().actions == "meta-actions" and EpisodeConfig().n_actions == 3
    assert EpisodeConfig(actions="accelerations").n_actions == 5
    for levels in ((0.0,), (1.0, 0.0), (0.0, 0.0), (0.0, float("inf"))):
        with pytest.raises(UserError, match="ascending"):
            EpisodeConfig(levels=levels)
