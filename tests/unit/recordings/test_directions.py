"""Directions of a mean vector: confidence regions and posteriors."""

import numpy as np
import pytest

from socialiq.recordings.directions import SECTOR, directions, posterior, sectors


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


def test_far_from_the_origin_it_is_students_t():
    """x̄ = (1000, 0), S of r_social 2: n = 4 gives t with 2 degrees of freedom, scale² 2 / (4 · 2).

    The quartile of that t is sqrt(2) / 2 · 2 / sqrt(3) = 0.8165 scales.
    """
    pairs = np.array([[1000.0, 1.0], [1000.0, -1.0], [1000.0, 0.0], [1000.0, 0.0]])
    drawn = posterior(pairs, 200_000, np.random.default_rng(0))
    quartile = np.degrees(0.5 * 0.8165 / 1000.0)
    assert np.quantile(drawn, 0.75) == pytest.approx(quartile, rel=0.02)
    assert np.quantile(drawn, 0.25) == pytest.approx(-quartile, rel=0.02)


def test_hotellings_directions_hold_at_least_their_confidence():
    rng = np.random.default_rng(1)
    pairs = rng.normal([8.0, 3.0], [1.0, 0.5], (6, 2))
    low, high = directions(pairs, 0.9)
    drawn = posterior(pairs, 20_000, rng)
    assert 0.9 < ((low <= drawn) & (drawn <= high)).mean() < 0.99


def test_no_spread_is_one_direction():
    drawn = posterior(np.tile([1.0, 1.0], (3, 1)), 50, np.random.default_rng(0))
    assert drawn == pytest.approx(np.full(50, 45.0))


def test_each_driver_counts_once():
    up, right = np.tile([0.1, 1.0], (9, 1)), np.tile([1.0, 0.1], (3, 1))
    found = {one.low: one for one in sectors([(up, False), (right, True), (right, True)], 0, 100)}
    assert len(found) == 360 / SECTOR
    assert found[75.0].share == pytest.approx(1 / 3) and found[75.0].share_moving == 0.0
    assert found[0.0].share == pytest.approx(2 / 3) and found[0.0].share_moving == 1.0
    assert sum(one.share for one in found.values()) == pytest.approx(1.0)


def test_nobody_moves_and_nobody_is_there():
    still = sectors([(np.tile([-0.15, 2.0], (3, 1)), False)], 0, 10)
    assert all(np.isnan(one.share_moving) for one in still)
    assert sectors([], 0, 10) == ()
