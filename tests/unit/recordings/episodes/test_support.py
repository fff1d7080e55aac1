"""Reliability of accelerations, and what labels leave out."""

import dataclasses

import numpy as np
import pytest

from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.support import left_out, rates, reliability, supported


def test_equal_measurements_are_reliable_and_independent_ones_are_not():
    rng = np.random.default_rng(100)
    one, other = rng.standard_normal((2, 20_000))
    assert reliability(one, one) == 1.0
    assert abs(reliability(one, other)) < 0.03
    # Signal and error of equal variance in each: half of the variance is shared.
    truth = rng.standard_normal(20_000)
    assert reliability(truth + one, truth + other) == pytest.approx(0.5, abs=0.03)
    assert np.isnan(reliability(np.zeros(3), np.zeros(3)))


def swinging(straight, error=0.0, seed=100):
    """A car whose speed swings by 2 m/s over 8 s, with errors of its stated speeds."""
    tracks = straight([8.0], frames=400)
    time = np.arange(400) * 0.1
    speed = 8.0 + 2.0 * np.sin(2 * np.pi * time / 8)
    made = 8.0 * time - 2.0 * 8 / (2 * np.pi) * (np.cos(2 * np.pi * time / 8) - 1)
    stated = speed + error * np.random.default_rng(seed).standard_normal(400)
    return dataclasses.replace(tracks, x=made, y=np.zeros(400), vx=stated, vy=np.zeros(400))


def test_exact_tracks_support_every_rate(straight):
    rows = rates([swinging(straight)])
    assert [row["seconds"] for row in rows] == [0.1, 0.2, 0.4, 0.5, 1.0, 2.0]
    assert min(row["reliability"] for row in rows) > 0.999
    assert supported(rows) == 0.1


def test_errors_of_speeds_leave_longer_decisions(straight):
    # Errors of 0.3 m/s: over D s accelerations err by 0.42 / D, and vary by about 1.1 m/s².
    rows = rates([swinging(straight, error=0.3)])
    by_seconds = {row["seconds"]: row["reliability"] for row in rows}
    assert by_seconds[0.1] < 0.3 and by_seconds[1.0] > 0.8
    assert supported(rows) in (0.4, 0.5, 1.0)
    assert supported([row for row in rows if row["seconds"] < 0.2]) is None


def test_durations_without_whole_frames_are_left_out(straight):
    tracks = dataclasses.replace(straight([8.0, 2.0], frames=40), dt=0.25)
    assert [row["seconds"] for row in rates([tracks])] == [0.5, 1.0, 2.0]


def test_a_fast_driver_is_idle_for_meta_actions(drive):
    speed = np.array([14.0, 12.0, 12.0, 14.0])
    one = dataclasses.replace(drive([[0.0, 0.0]] * 3), speed=speed)
    meta, levels = left_out([one], [0.1], EpisodeConfig())
    assert (meta["decisions"], meta["changes"]) == (3, 2)
    assert meta["labelled_none"] == 1.0 and meta["brakings_labelled_none"] == 1.0
    assert meta["squares_left"] > 1.0  # toward 9 m/s: worse than no change at all
    assert levels["labelled_none"] == 0.0 and levels["squares_left"] == pytest.approx(0.0)
