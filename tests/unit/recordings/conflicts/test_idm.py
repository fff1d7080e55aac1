"""The intelligent driver model against its equations' known points."""

import math

import pytest

from socialiq.errors import UserError
from socialiq_recordings.conflicts.idm import Idm, acceleration, ballistic


def test_an_empty_road():
    assert acceleration(Idm(), 0.0, math.inf, 0.0) == 1.0
    assert acceleration(Idm(), 15.0, math.inf, 0.0) == 0.0
    assert acceleration(Idm(), 7.5, math.inf, 0.0) == pytest.approx(1 - 0.5**4)


def test_the_equilibrium_gap_holds_the_speed():
    # s_e(v) = (s0 + v T) / sqrt(1 - (v / v0)^δ), the equilibrium of the two equations
    for speed in (2.0, 8.0, 14.0):
        gap = (2.0 + speed * 1.0) / math.sqrt(1 - (speed / 15.0) ** 4)
        assert acceleration(Idm(), speed, gap, speed) == pytest.approx(0.0, abs=1e-12)


def test_a_standing_vehicle_at_the_jam_distance_stays():
    assert acceleration(Idm(), 0.0, 2.0, 0.0) == 0.0
    assert acceleration(Idm(), 0.0, 1.0, 0.0) == -3.0  # 1 - (2 / 1)²
    assert acceleration(Idm(), 10.0, 0.0, 0.0) == -8.0


def test_approach_by_hand():
    # v = 10, v_l = 5: s* = 2 + 10 + 10 * 5 / (2 sqrt(1.5)); gap 40
    wanted = 12.0 + 50.0 / (2 * math.sqrt(1.5))
    expected = 1 - (10 / 15) ** 4 - (wanted / 40) ** 2
    assert acceleration(Idm(), 10.0, 40.0, 5.0) == pytest.approx(expected)


def test_a_step_of_constant_acceleration():
    assert ballistic(10.0, 2.0, 1.0) == (11.0, 12.0)
    assert ballistic(2.0, -4.0, 1.0) == (0.5, 0.0)


def test_parameters_are_positive():
    with pytest.raises(UserError, match="time_headway"):
        Idm(time_headway=0.0)
