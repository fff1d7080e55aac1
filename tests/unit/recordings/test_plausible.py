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


@pytest.mark.parametrize("sigma", [0.03, 0.15])
def test_a_parked_box_that_jitters_refuses_nothing(straight, sigma):
    # As in Argoverse 2: stated 0.00 m/s, the box moves by centimetres from frame to frame and by up
    # to metres in all; most vehicles of a street are parked.
    tracks, random = straight([0.0] * 9 + [8.0], frames=110), np.random.default_rng(3)
    still = tracks.track < 9
    drift = np.where(still, 0.25 * np.sin(tracks.frame / 30 + tracks.track), 0.0)
    x, y = (
        place + drift + random.normal(0, sigma, len(still)) * still
        for place in (tracks.x, tracks.y)
    )
    kept, refused = sift(replace(tracks, x=x, y=y))
    assert refused == [] and kept.n_tracks == 10


def test_who_creeps_is_not_judged_by_the_noise_of_its_positions(straight):
    tracks, random = straight([2.2, 2.5, 8.0], frames=60), np.random.default_rng(0)
    x, y = (place + random.normal(0, 0.15, len(place)) for place in (tracks.x, tracks.y))
    assert sift(replace(tracks, x=x, y=y))[1] == []


def articulated(straight, arm, reach, noise=0.0, turn=0.0):
    """A truck of 6 m and its trailer of 8 m, whose front is `reach` m before its middle."""
    tracks, random = straight([8.0, 8.0, 8.0], frames=40, apart=30.0), np.random.default_rng(0)
    angle = np.linspace(0.0, turn, 40)
    first, second = tracks.track == 0, tracks.track == 1
    x, y, heading = tracks.x.copy(), tracks.y.copy(), tracks.heading.copy()
    hitch = np.stack([x[first] - arm, y[first]])
    heading[second] = angle
    x[second], y[second] = hitch[0] - reach * np.cos(angle), hitch[1] - reach * np.sin(angle)
    x, y = (place + random.normal(0, noise, len(place)) if noise else place for place in (x, y))
    length = np.array([6.0, 8.0, 4.5])
    vx, vy = np.cos(heading) * 8.0, np.sin(heading) * 8.0
    return replace(tracks, x=x, y=y, heading=heading, length=length, vx=vx, vy=vy)


@pytest.mark.parametrize(("noise", "turn"), [(0.0, 0.0), (0.05, 0.0), (0.0, 0.25), (0.05, 0.25)])
def test_a_trailer_may_overlap_at_the_hitch(straight, noise, turn):
    error = MeasurementError(position=0.05, speed=0.4, size=0.1)
    # Straight: 3 + 4 - 5.5 = 1.5 m deep, where 0.3 may be error.
    assert sift(articulated(straight, 2.0, 3.5, noise, turn), error)[1] == []


def test_two_boxes_of_one_vehicle_and_parked_ones_that_overlap_are_no_trailer(straight):
    error = MeasurementError(position=0.05, speed=0.4, size=0.1)
    double = articulated(straight, 0.2, 0.3)
    assert [one.identity for one in sift(double, error)[1]] == ["100", "101"]
    parked = articulated(straight, 2.0, 3.5)
    x = np.where(parked.track < 2, parked.x[parked.track * 40], parked.x)
    vx = np.where(parked.track < 2, 0.0, parked.vx)
    still = replace(parked, x=x, vx=vx)
    assert [one.identity for one in sift(still, error)[1]] == ["100", "101"]
    # One that drives through the other has no fixed point in both.
    through = replace(parked, x=np.where(parked.track == 1, parked.x * 0.9, parked.x))
    assert {"100", "101"} <= {one.identity for one in sift(through, error)[1]}
