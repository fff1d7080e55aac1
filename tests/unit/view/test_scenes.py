"""Vehicles from observations."""

import numpy as np
import pytest

from socialiq.view.demonstrations import scenes_of


def row(x, y, vx, vy):
    speed = np.hypot(vx, vy) or 1.0
    return [1.0, x / 100, y / 100, vx / 20, vy / 20, vx / speed, vy / speed]


EMPTY = [0.0] * 7


def test_places_and_speeds_are_in_metres():
    seen = np.array([[*row(10, -20, 3, 4), *EMPTY]], np.float32)
    ((ego,),) = scenes_of(seen, 1.0)
    assert ego == pytest.approx([10, -20, np.arctan2(4, 3), 5, 0], abs=1e-4)


def test_vehicles_keep_their_numbers_when_the_order_of_the_rows_changes():
    first = [*row(0, 0, 0, 5), *row(30, 2, -9, 0), *row(-30, -2, 9, 0)]
    then = [*row(0, 5, 0, 5), *row(-21, -2, 9, 0), *row(21, 2, -9, 0)]
    one, two = scenes_of(np.array([first, then], np.float32), 1.0)
    assert [vehicle[4] for vehicle in one] == [0, 1, 2]
    assert [vehicle[4] for vehicle in two] == [0, 2, 1]


def test_one_that_leaves_and_one_that_enters_are_not_the_same():
    first = [*row(0, 0, 0, 0), *row(30, 2, -9, 0)]
    then = [*row(0, 0, 0, 0), *row(-60, -2, 9, 0)]
    _, two = scenes_of(np.array([first, then], np.float32), 1.0)
    assert [vehicle[4] for vehicle in two] == [0, 2]


def test_the_ego_stays_the_ego_and_a_clock_is_ignored():
    first, then = [*row(0, 0, 0, 0), 0.0], [*row(90, 90, 0, 0), 1.0]
    scenes = scenes_of(np.array([first, then], np.float32), 1.0)
    assert [len(one) for one in scenes] == [1, 1] and scenes[1][0][4] == 0
