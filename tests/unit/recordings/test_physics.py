"""The intelligent driver model and rectangles against known points of their equations."""

import math
from dataclasses import replace

import numpy as np
import pytest

from socialiq_recordings.physics import Idm, acceleration, ballistic, overlaps


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


def test_a_step_of_constant_acceleration():
    driven, after = ballistic(np.array([10.0, 2.0]), np.array([2.0, -4.0]), 1.0)
    assert driven.tolist() == [11.0, 0.5] and after.tolist() == [12.0, 0.0]


def test_depths_of_overlaps_are_those_of_paper(straight):
    # Side by side: 1.8 m wide, 1.5 m apart: 0.3 m. Only at common frames.
    found = overlaps(straight([0.0, 0.0], frames=2, apart=1.5))
    np.testing.assert_allclose(found.depth, [0.3, 0.3])
    pairs = {frozenset(pair) for pair in zip(*(one.tolist() for one in found[:2]), strict=True)}
    assert pairs == {frozenset((0, 2)), frozenset((1, 3))}
    # One turned by 45° and 2.5 m to the left: its corner reaches (4.5 + 1.8) / 2 · sin 45° = 2.227,
    # so 0.9 + 2.227 - 2.5 = 0.627 m along y; its own long axis: 2.25 + 2.227 - 1.768 = 2.710 m.
    turned = straight([0.0, 0.0], frames=1, apart=2.5)
    turned = replace(turned, heading=np.array([0.0, np.pi / 4]))
    np.testing.assert_allclose(overlaps(turned).depth, [0.9 + 6.3 / 2 * np.sqrt(0.5) - 2.5])
    # 3.2 m to the left the circles meet, the rectangles don't.
    assert len(overlaps(replace(turned, y=np.array([0.0, 3.2]))).depth) == 0


def test_overlaps_do_not_depend_on_blocks_of_frames(straight, monkeypatch):
    tracks = straight([1.0, 2.0, 3.0, 4.0], frames=30, apart=1.0)
    whole = overlaps(tracks)
    monkeypatch.setattr("socialiq_recordings.physics._BLOCK", 10)
    parts = overlaps(tracks)
    assert len(whole.depth) == len(parts.depth) > 0
    ours, theirs = (
        {(frozenset((a, b)), round(depth, 9)) for a, b, depth in zip(*found, strict=True)}
        for found in (whole, parts)
    )
    assert ours == theirs
