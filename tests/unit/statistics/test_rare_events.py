"""Differences that are nearly all equal: bounded by how often they may deviate."""

import numpy as np
import pytest

from socialiq.statistics import intervals as rare


def test_equal_episodes_leave_a_rest():
    # P(no deviation in 100) = 0.05 at p = 1 - 0.05^(1/100) = 0.029513
    found = rare.bounds(np.zeros(100), 10.0, 0.05, 0.05)
    assert found.high == pytest.approx(10 * (1 - 0.05**0.01))
    assert found.low == -found.high


def test_the_rest_is_counted_from_the_common_value():
    found = rare.bounds(np.full(50, 2.0), 10.0, 0.025, 0.05)
    assert found.high == pytest.approx(2 + 8 * (1 - 0.05 ** (1 / 50)))
    assert found.low == pytest.approx(2 - 12 * (1 - 0.025 ** (1 / 50)))


def test_one_that_deviates_widens_the_bound():
    values = np.zeros(100)
    values[3] = 1.0
    assert rare.deviating(values, 10.0) == 1
    # Clopper and Pearson: p with P(at most 1 of 100) = 0.05
    assert rare.bounds(values, 10.0, 0.05, 0.05).high == pytest.approx(0.4656, abs=1e-4)


@pytest.mark.parametrize(("count", "expected"), [(0, True), (19, True), (20, False), (100, False)])
@pytest.mark.parametrize("place", [0, 200])
def test_seldom_is_less_than_twenty(count, expected, place):
    values = np.zeros(1000)
    values[place : place + count] = 1.0 + np.arange(count)
    assert rare.seldom(values, 10.0) is expected


def test_rounding_is_no_deviation():
    assert rare.deviating(np.array([1.0, 1.0 + 1e-13, 1.0, 2.0]), 10.0) == 1


def test_episodes_needed_by_hand():
    # -log 0.05 = 2.9957, the rule of three, times a reach of 10, over 0.5: 59.9
    assert rare.episodes_if_rare(0.5, 0.0, 10.0, 0, 0.05) == 60
    assert rare.episodes_if_rare(0.0, 0.0, 10.0, 0, 0.05) is None
    assert rare.bounds(np.zeros(60), 10.0, 0.05, 0.05).high <= 0.5
