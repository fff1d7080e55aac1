"""Each measure against a case that can be computed on paper."""

import math

import pytest

from socialiq_recordings.conflicts.measures import (
    post_encroachment_time,
    required_deceleration,
    required_deceleration_crossing,
    time_to_collision,
    time_to_collision_crossing,
)


def test_pet_is_from_the_first_rear_to_the_second_front():
    assert post_encroachment_time(first_leaves=4.0, second_arrives=5.5) == 1.5
    assert post_encroachment_time(first_leaves=4.0, second_arrives=3.5) == -0.5


def test_ttc_behind_a_leader_is_the_gap_by_the_closing_speed():
    assert time_to_collision(gap=20.0, speed=15.0, leader_speed=10.0) == 4.0
    assert time_to_collision(20.0, 10.0, 10.0) == math.inf
    assert time_to_collision(20.0, 10.0, 12.0) == math.inf
    assert time_to_collision(0.0, 10.0, 12.0) == 0.0


def test_ttc_of_crossing_ways_is_the_later_arrival_while_the_first_is_inside():
    # 30 m at 10 m/s and 7 m long over 3 m: inside from 3 to 4 s; the other arrives at 3.5 s.
    assert time_to_collision_crossing((3.0, 4.0), (3.5, 5.0)) == 3.5
    assert time_to_collision_crossing((3.5, 5.0), (3.0, 4.0)) == 3.5
    assert time_to_collision_crossing((3.0, 4.0), (4.5, 5.0)) == math.inf
    assert time_to_collision_crossing((3.0, math.inf), (math.inf, math.inf)) == math.inf
    assert time_to_collision_crossing((-1.0, 4.0), (-0.5, 5.0)) == 0.0


def test_the_deceleration_behind_a_leader_stops_closing_as_the_gap_ends():
    needed = required_deceleration(gap=25.0, speed=15.0, leader_speed=10.0)
    assert needed == 0.5
    # At 0.5 m/s² the closing speed of 5 m/s takes 10 s, and 25 m, to vanish.
    assert 5.0 * 10 - needed * 10**2 / 2 == 25.0
    assert required_deceleration(25.0, 10.0, 10.0) == 0.0
    assert required_deceleration(0.0, 11.0, 10.0) == math.inf


def test_the_deceleration_before_an_area_arrives_as_the_other_leaves():
    # 10 m/s, 30 m away, 4 s: 40 m would be driven, 10 too many: b = 2 * 10 / 16.
    needed = required_deceleration_crossing(gap=30.0, speed=10.0, seconds=4.0)
    assert needed == 1.25
    assert 10.0 * 4 - needed * 4**2 / 2 == 30.0


def test_or_it_stops_at_the_area():
    assert required_deceleration_crossing(20.0, 10.0, math.inf) == 2.5
    assert required_deceleration_crossing(20.0, 10.0, 8.0) == 2.5
    # Both forms agree where it comes to a stand as the other leaves.
    assert required_deceleration_crossing(20.0, 10.0, 4.0) == 2.5
    assert required_deceleration_crossing(20.0, 10.0, 4.0 - 1e-9) == pytest.approx(2.5)


def test_no_deceleration_is_needed_by_those_who_arrive_later():
    assert required_deceleration_crossing(30.0, 10.0, 3.0) == 0.0
    assert required_deceleration_crossing(30.0, 0.0, math.inf) == 0.0
    assert required_deceleration_crossing(0.0, 10.0, 1.0) == math.inf
