"""One place is one site in whatever frame it is drawn; another place is another."""

import numpy as np
import pytest

from socialiq_recordings.identity.alignment import Placement, shape_of, shared


def shape(make, *junction, **where):
    return shape_of(make.recording(make.traffic(), make.junction(*junction, **where)))


@pytest.mark.parametrize(("turn", "x"), [(0.0, 0.0), (0.0, 55.0), (1.0, 0.0), (-2.5, 300.0)])
def test_a_road_that_is_moved_and_turned_is_the_same(make, turn, x):
    assert min(shared(shape(make, make.t), shape(make, make.t, turn=turn, x=x))) > 0.95


def test_another_junction_is_not(make):
    assert max(shared(shape(make, make.t), shape(make, make.y))) < 0.8


def test_straight_roads_and_paths_are_compared_where_they_are(make):
    one = shape(make, (0.0,))
    assert shared(one, shape(make, (0.0,))) == (1.0, 1.0)
    assert shared(one, shape(make, (0.0,), x=500.0)) == (0.0, 0.0)
    paths = shape_of(make.recording(make.traffic()))
    assert not paths.of_road and shared(paths, paths) == (1.0, 1.0)


def test_a_placement_goes_there_and_back():
    points = np.array([[1.0, 2.0, 0.5], [-3.0, 4.0, -1.0]])
    placement = Placement(np.pi / 2, np.array([10.0, 0.0]))
    np.testing.assert_allclose(placement.of(points)[0], [8.0, 1.0, 0.5 + np.pi / 2])
    np.testing.assert_allclose(placement.back(placement.of(points)), points)
