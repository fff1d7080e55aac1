"""The same moments in two recordings are found by motion, whatever their frames and numbers are."""

from dataclasses import replace

import numpy as np
import pytest

from socialiq_recordings.identity.alignment import Motion, Placement, in_common


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_overlapping_windows_share_every_vehicle(make, turn, noise):
    whole = make.traffic()
    one, two = make.window(whole, 0, 60, "a"), make.window(whole, 45, 100, "b")
    two = make.written(two, Placement(turn, np.array([100.0, -40.0])), digits=2, noise=noise)
    found = in_common(Motion(one), Motion(two))
    assert found is not None
    assert (found.lag, found.seconds) == (pytest.approx(-4.5), pytest.approx(1.5))
    # Each vehicle is found as itself, those that stand too.
    assert sorted(map(tuple, found.vehicles.tolist())) == [(n, n) for n in range(8)]


def test_windows_apart_and_other_traffic_share_nothing(make):
    whole = make.traffic()
    one, two = make.window(whole, 0, 50, "a"), make.window(whole, 50, 100, "b")
    assert in_common(Motion(one), Motion(two)) is None
    for seed in range(1, 6):
        assert in_common(Motion(whole), Motion(make.traffic(seed))) is None


def test_a_crop_and_another_frame_rate_are_the_same_moments(make):
    whole = make.traffic()
    few = whole.select(np.arange(8) < 3)
    found = in_common(Motion(whole), Motion(few))
    assert found is not None and len(found.vehicles) == 3
    rows = whole.frame % 2 == 0
    states = {n: getattr(whole, n)[rows] for n in ("track", "x", "y", "heading", "vx", "vy")}
    slower = replace(whole, **states, frame=(whole.frame[rows] // 2).astype(np.int32), dt=0.2)
    found = in_common(Motion(slower), Motion(whole))
    assert found is not None and len(found.vehicles) == 8 and found.lag == pytest.approx(0.0)


def test_traffic_that_stands_proposes_nothing(make):
    still = make.traffic(moving=0, standing=3)
    assert in_common(Motion(still), Motion(still)) is None
