"""Posteriors of directions of a mean vector, and their mixture."""

import numpy as np
import pytest

from socialiq.social.angle import direction_interval
from socialiq_recordings.directions import SECTOR, posterior, sectors


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
    low, high = direction_interval(pairs, 0.9)
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
