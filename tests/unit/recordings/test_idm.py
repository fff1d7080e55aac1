"""The intelligent driver model against known points of its equations."""

import math

import pytest

from socialiq_recordings.idm import Idm, acceleration


def test_an_empty_road():
    assert acceleration(0.0, math.inf, 0.0, *Idm()) == 1.0
    assert acceleration(15.0, math.inf, 0.0, *Idm()) == 0.0
    assert acceleration(7.5, math.inf, 0.0, *Idm()) == pytest.approx(1 - 0.5**4)


def test_the_equilibrium_gap_holds_the_speed():
    # s_e(v) = (s0 + v T) / sqrt(1 - (v / v0)^δ), the equilibrium of the two equations
    for speed in (2.0, 8.0, 14.0):
        gap = (2.0 + speed * 1.0) / math.sqrt(1 - (speed / 15.0) ** 4)
        assert acceleration(speed, gap, speed, *Idm()) == pytest.approx(0.0, abs=1e-12)


def test_a_standing_vehicle_at_the_jam_distance_stays():
    assert acceleration(0.0, 2.0, 0.0, *Idm()) == 0.0
    assert acceleration(0.0, 1.0, 0.0, *Idm()) == -3.0  # 1 - (2 / 1)²
    assert acceleration(10.0, 0.0, 0.0, *Idm()) == -8.0


def test_approach_by_hand():
    # v = 10, v_l = 5: s* = 2 + 10 + 10 * 5 / (2 sqrt(1.5)); gap 40
    wanted = 12.0 + 50.0 / (2 * math.sqrt(1.5))
    expected = 1 - (10 / 15) ** 4 - (wanted / 40) ** 2
    assert acceleration(10.0, 40.0, 5.0, *Idm()) == pytest.approx(expected)


def test_a_faster_leader_shortens_the_desired_gap_to_the_jam_distance_at_most():
    # v T + v (v - v_l) / (2 sqrt(a b)) = 10 - 204.1 m, so s* = s0 = 2 m; gap 4 m
    assert acceleration(10.0, 4.0, 60.0, *Idm()) == pytest.approx(1 - (10 / 15) ** 4 - 0.25)
