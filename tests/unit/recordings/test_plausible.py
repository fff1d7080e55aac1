"""Impossible values are left out; those of a wrong unit are refused by its name."""

import re
from dataclasses import replace

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.plausible import MeasurementError, sift
from socialiq_recordings.recording import RoadUser


def of_track(tracks, one, **columns):
    """The same tracks with columns of one of them changed by functions."""
    rows = tracks.track == one
    changed = {}
    for name, change in columns.items():
        column = getattr(tracks, name).copy()
        place = rows if len(column) == len(rows) else one
        column[place] = change(column[place])
        changed[name] = column
    return replace(tracks, **changed)


@pytest.fixture
def three(straight):
    return straight([8.0, 9.0, 10.0])


def test_good_tracks_stay_as_they_are(three):
    kept, refused = sift(three)
    assert refused == []
    for name, column in three.arrays().items():
        np.testing.assert_array_equal(getattr(kept, name), column)


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        # In 0.9 s at 9 m/s: 3 (0.25² + 2 (0.25 / 0.9)² + (0.05 · 9)²)^½ = 1.94 m/s.
        (
            {"vx": lambda v: v + 2.0},
            r"drives 9.00 m/s but states 11.00 \(means; 2.00 apart in 0.9 s, where 1.94",
        ),
        ({"vx": lambda v: v * 0.0}, "drives 9.00 m/s but states 0.00"),
        ({"x": lambda x: x + 1.6 * (np.arange(10) > 4)}, "jumps 1.60 m further .* after frame 4"),
        ({"heading": lambda h: h + 0.4}, "heading 23° off the way it moves"),
        ({"vx": lambda v: -v}, "velocity 180° off the way it moves"),
        ({"width": lambda w: 5.0}, "4.5 m long and 5 m wide"),
        ({"length": lambda w: 31.0}, "31 m long"),
        ({"length": lambda w: 0.1}, "0.1 m long"),
        ({"y": lambda y: y - 9.4}, "overlaps by 1.20 m with 100 at frame"),
        ({"x": lambda x: x + 1e20}, "above 1e[+]08"),
    ],
)
def test_a_track_that_cannot_be_true_is_left_out(three, columns, reason):
    kept, refused = sift(of_track(three, 1, **columns))
    [mine] = [one for one in refused if one.identity == "101"]
    assert re.search(reason, mine.reason), mine
    assert 102 in kept.identity and 101 not in kept.identity


def test_what_lies_within_the_tolerances_stays(three):
    noisy = of_track(three, 1, vx=lambda v: v + 1.35, heading=lambda h: h + 0.33)
    # 1.4 m to the left, turned by 19°: 0.9 + 2.25 sin + 0.9 cos - 1.4 = 1.08 m deep, of 1.14.
    near = of_track(noisy, 1, y=lambda y: y - 8.6)
    assert sift(near)[1] == []


def test_tolerances_follow_from_the_stated_error(three):
    drone = MeasurementError(position=0.05, speed=0.1, size=0.1, scale=0.01)
    assert drone.jump(0.04) == pytest.approx(3 * np.hypot(np.sqrt(2) * 0.05, 0.004))
    assert drone.overlap == pytest.approx(3 * np.sqrt(2 * 0.05**2 + 0.1**2 / 2))
    assert np.degrees(drone.direction) == pytest.approx(20.0)
    slow = of_track(three, 1, vx=lambda v: v + 0.6)
    assert sift(slow)[1] == [] and len(sift(slow, drone)[1]) == 1
    with pytest.raises(UserError, match="error of position must be a number above 0"):
        MeasurementError(position=0.0)


def test_who_reverses_moves_along_its_axis(three):
    reversing = of_track(three, 1, heading=lambda h: np.full_like(h, np.pi))
    assert sift(reversing)[1] == []


def test_people_may_walk_sideways(three):
    sideways = of_track(three, 1, heading=lambda h: h + np.pi / 2)
    assert "heading 90°" in sift(sideways)[1][0].reason
    walkers = replace(sideways, road_user=np.array([0, RoadUser.PEDESTRIAN, 0], np.int8))
    assert sift(walkers)[1] == []


def test_nobody_is_faster_than_a_race_car(straight):
    kept, refused = sift(straight([8.0, 9.0, 71.0]))
    assert refused[0].reason == "states 71.0 m/s, more than 70" and kept.n_tracks == 2


def test_both_of_two_that_overlap_go_and_one_refused_before_does_not_count(straight):
    tracks = straight([8.0, 8.0, 8.0], apart=0.5)  # 1.3 m deep, each in the next
    with pytest.raises(UserError, match="none of the 3 tracks can be true; the first, 100"):
        sift(tracks)
    # The middle one is refused for its size, and the others are 0.8 m deep, within the error.
    kept, refused = sift(of_track(tracks, 1, length=lambda one: 40.0))
    assert kept.identity.tolist() == [100, 102] and len(refused) == 1


FOOT = 0.3048


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda t: replace(t, x=t.x / FOOT, y=t.y / FOOT), "3.28 times .* positions are in feet"),
        (lambda t: replace(t, vx=t.vx / FOOT), "0.305 times .* velocities are in feet per second"),
        (lambda t: replace(t, vx=t.vx * 3.6), "0.278 times .* velocities are in km/h"),
        (lambda t: replace(t, vx=t.vx / 0.44704), "velocities are in miles per hour"),
        (lambda t: replace(t, dt=0.04), "2.5 times .* frame rate"),
        (
            lambda t: replace(t, length=t.length / FOOT, width=t.width / FOOT),
            "3 of 3 tracks have impossible sizes, which are possible in feet",
        ),
    ],
)
def test_a_wrong_unit_refuses_the_file_by_its_name(three, change, line):
    with pytest.raises(UserError, match=line):
        sift(change(three))


@pytest.mark.parametrize(
    ("read", "line"),
    [
        (np.radians, "radians, read as degrees"),
        (lambda heading: -heading, "clockwise: does y point down"),
        (lambda heading: np.pi / 2 - heading, "clockwise from north"),
        (lambda heading: heading + 1.4, "headings are wrong"),
    ],
)
def test_wrong_headings_refuse_the_file_by_what_explains_them(straight, read, line):
    tracks = straight([8.0, 9.0, 10.0], heading=1.2)
    with pytest.raises(UserError, match=f"in 3 of 3 tracks the heading.*{line}"):
        sift(replace(tracks, heading=read(tracks.heading)))


def test_headings_in_degrees_near_the_axis_are_told_by_their_factor(straight):
    tracks = straight([8.0, 9.0, 10.0], heading=0.03)
    with pytest.raises(UserError, match="degrees, read as radians"):
        sift(replace(tracks, heading=np.degrees(tracks.heading)))


def test_velocities_along_other_axes_refuse_the_file(straight):
    tracks = straight([8.0, 9.0, 10.0], heading=1.2)
    with pytest.raises(UserError, match="the velocity does not point the way"):
        sift(replace(tracks, vy=-tracks.vy))
