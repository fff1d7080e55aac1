"""Directions of a mean vector's confidence region."""

import numpy as np
import pytest

from socialiq.recordings.directions import directions


def test_the_region_seen_from_the_origin():
    """A circle of radius r around (d, 0) is seen under ± asin(r / d)."""
    rows = np.array([[3.0, 1.0], [3.0, -1.0], [4.0, 0.0], [2.0, 0.0]])
    # n = 4, S = 2/3 I, F(0.95; 2, 2) = 19: r² = 2/3 · 2·3/2 · 19 / 4
    radius = np.sqrt(2 / 3 * 3 * 19 / 4)
    assert directions(rows, 0.95) is None  # 3.08 > 3
    rows[:, 0] += 4.0
    low, high = directions(rows, 0.95)
    expected = np.degrees(np.arcsin(radius / 7.0))
    assert (low, high) == pytest.approx((-expected, expected), abs=1e-3)


def test_no_spread_is_one_direction_and_zero_is_none():
    assert directions(np.tile([1.0, 1.0], (3, 1)), 0.95) == pytest.approx((45.0, 45.0))
    assert directions(np.zeros((5, 2)), 0.95) is None


def test_the_ends_go_beyond_half_a_turn():
    rows = np.array([[-50.0, 1.0], [-50.0, -1.0], [-51.0, 0.3], [-49.0, 0.0]])
    low, high = directions(rows, 0.9)
    assert low < 180.0 < high and high - low < 20.0


def test_it_covers_the_truth_as_often_as_promised():
    rng = np.random.default_rng(3)
    hits, angle = 0, np.degrees(np.arctan2(0.5, 2.0))
    for _ in range(400):
        found = directions(rng.normal([2.0, 0.5], [1.0, 0.5], (6, 2)), 0.9)
        hits += found is None or found.low <= angle <= found.high
    assert hits / 400 > 0.9  # of the directions at least as often as of the vector
