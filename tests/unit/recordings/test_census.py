"""The census of made-up drivers, by hand."""

import math

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq_recordings.census import circular_sd, take


def test_a_drivers_point_is_the_mean_of_its_decisions(human):
    found = take(human).drivers
    assert [one.decisions for one in found] == [2, 1, 1, 3, 4]
    first = found[0]
    assert (first.r_env, first.r_social) == pytest.approx((0.2, 0.1))
    assert first.angle == pytest.approx(math.degrees(math.atan2(0.1, 0.2)))
    assert (first.low, first.high) == (None, None)  # two decisions leave every direction open
    assert [one.ending for one in found[:3]] == ["truncated", "arrival", "collision"]
    assert (found[3].low, found[3].high) == pytest.approx((45.0, 45.0))
    assert first.residual == pytest.approx(0.5)


def test_the_population_counts_every_driver_once(human):
    found = take(human).population
    points = np.array([[0.2, 0.1], [0.5, -1.0], [-2.0, -5.0], [0.2, 0.2], [0.0, 0.4]])
    assert (found.r_env, found.r_social) == pytest.approx(tuple(points.mean(axis=0)))
    assert (found.sd_env, found.sd_social) == pytest.approx(tuple(points.std(axis=0, ddof=1)))
    angle = math.degrees(math.atan2(points[:, 1].mean(), points[:, 0].mean()))
    for interval in (found.over_drivers, found.over_chains):
        assert interval is not None
        assert interval.estimate == pytest.approx(angle)
        assert interval.low <= angle <= interval.high
    assert (found.drivers, found.recordings, found.with_direction) == (5, 3, 2)


def test_recordings_count_as_units_where_drivers_of_one_are_alike(drive, swapped):
    """Ten copies of a driver say no more than one."""
    alike = [
        swapped(f"r{n}", [drive([[1.0, math.tan(math.radians(10 * n))]])] * 10) for n in range(6)
    ]
    found = take(alike).population
    drivers, recordings = found.over_drivers, found.over_chains
    assert recordings is not None
    widths = drivers.high - drivers.low, recordings.high - recordings.low
    assert 2.0 < widths[1] / widths[0] < 4.5  # sqrt(10) = 3.2
    assert take(alike[:1]).population.over_chains is None


def test_a_driver_to_whom_nothing_happened_has_no_angle(drive, swapped):
    found = take([swapped("a", [drive([[0.0, 0.0]]), drive([[1.0, 0.0]])])])
    assert found.drivers[0].angle is None and found.drivers[1].angle == 0.0


def test_circular_sd_by_hand():
    assert circular_sd(np.radians([10.0, 10.0])) == pytest.approx(0.0, abs=1e-5)
    length = math.cos(math.radians(30))
    expected = math.degrees(math.sqrt(-2 * math.log(length)))
    assert circular_sd(np.radians([-30.0, 30.0])) == pytest.approx(expected)
    assert circular_sd(np.radians([150.0, -150.0])) == pytest.approx(expected)


def test_nobody_is_no_census(swapped):
    with pytest.raises(UserError, match="no driver to count"):
        take([swapped("a", [])])


def test_the_same_seed_gives_the_same_intervals(human):
    assert take(human, seed=4) == take(human, seed=4)
    assert take(human, seed=4) != take(human, seed=5)
    assert take(human).drivers[1].ending == Ending.ARRIVAL.name.lower()
