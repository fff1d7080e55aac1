"""Coordinates along lines, by hand."""

import math

import numpy as np
import pytest

from socialiq_recordings.road.paths import Arc, Polyline, path_of

CORNER = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0]])


def at(path, x, y):
    found = path.coordinates(np.array([x]), np.array([y]))
    return [float(column[0]) for column in found]


@pytest.mark.parametrize(
    ("x", "y", "along", "lateral", "degrees"),
    [
        (4.0, 1.0, 4.0, 1.0, 0),
        (4.0, -1.0, 4.0, -1.0, 0),
        (-3.0, 2.0, -3.0, 2.0, 0),  # before the start: along the extension
        (9.0, 3.0, 13.0, 1.0, 90),
        (8.0, 9.0, 19.0, 2.0, 90),  # behind the end
        (11.0, -1.0, 10.0, -math.sqrt(2), 0),  # outside the corner: the corner itself
    ],
)
def test_a_point_is_projected_on_the_nearest_piece(x, y, along, lateral, degrees):
    assert at(Polyline(CORNER), x, y) == pytest.approx([along, lateral, math.radians(degrees)])


def test_a_polyline_knows_its_length():
    path = Polyline(CORNER)
    assert path.length == 15.0


def circle(sense, count=20):
    turn = np.linspace(0.0, math.pi / 2, count) * sense
    return np.stack([3.0 + 10.0 * np.cos(turn), 4.0 + 10.0 * np.sin(turn)], axis=1)


@pytest.mark.parametrize("sense", [1, -1])
def test_points_of_a_circle_make_an_arc(sense):
    path = path_of(circle(sense))
    assert isinstance(path, Arc)
    assert path.length == pytest.approx(5 * math.pi)
    # 1 rad along, 2 m outside: outside lies to the right of a left turn
    x, y = 3.0 + 12.0 * math.cos(sense), 4.0 + 12.0 * math.sin(sense)
    along, lateral, heading = at(path, x, y)
    assert (along, lateral) == pytest.approx((10.0, -2.0 * sense))
    assert heading == pytest.approx(sense * (1 + math.pi / 2))


def test_an_arc_that_is_not_quite_one_stays_a_polyline():
    points = circle(1)
    points[7] += 1e-3
    assert isinstance(path_of(points), Polyline)
    assert isinstance(path_of(circle(1, count=5)), Polyline)  # five points prove nothing
    assert isinstance(path_of(np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]])), Polyline)


def test_on_an_arc_the_error_of_a_polyline_is_gone():
    """Half a metre inside, pieces of 0.5 m would be off by up to a centimetre."""
    path = path_of(circle(1))
    for turn in np.linspace(0.01, 1.5, 17):
        x, y = 3.0 + 9.5 * math.cos(turn), 4.0 + 9.5 * math.sin(turn)
        assert at(path, x, y)[0] == pytest.approx(10.0 * turn, abs=1e-9)
