"""Ego's observation: rows of seven numbers, by distance along its own lane."""

import numpy as np
import pytest

from socialiq.types import Ending
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

EAST, NORTH, WEST = 0.0, -90.0, 180.0
HAIR = 1e-12  # m; differences that only rounding makes


@pytest.fixture(scope="module")
def seen(annotated, car):
    """Observed rows of the others for an ego at (2, 50) that drives north."""

    def make(*others, options=None, **ego):
        cars = [car(2, 50, NORTH, 9.0, destination=1, **ego), *others]
        return annotated(cars, cars, options).reached[0]

    return make


def places(observation):
    """(x, y) in whole metres of the rows but the ego's."""
    rows = observation[1:][observation[1:, 0] > 0]
    return [tuple(np.rint(row[1:3] * 100).astype(int).tolist()) for row in rows]


def test_a_row_is_presence_place_velocity_and_direction(seen, car):
    found = seen(car(-20, 2, EAST, 8.0))
    assert found.shape == (10, 7) and found.dtype == np.float32
    np.testing.assert_allclose(found[0], [1, 0.02, 0.5, 0, -0.45, 0, -1], atol=1e-7)
    np.testing.assert_allclose(found[1], [1, -0.2, 0.02, 0.4, 0, 1, 0], atol=1e-7)
    assert not found[2:].any()


def test_far_and_fast_is_clipped(seen, car):
    found = seen(car(-120, -105, WEST, 30.0))
    np.testing.assert_allclose(found[1], [1, -1, -1, -1, 0, -1, 0], atol=1e-7)


def test_rows_are_sorted_by_distance_along_the_egos_lane(seen, car):
    others = [car(2, 10, NORTH, 5), car(60, 45, WEST, 5), car(-2, 56, 90, 5), car(-30, 30, EAST, 5)]
    assert places(seen(*others)) == [(60, 45), (-2, 56), (-30, 30), (2, 10)]


def test_who_is_more_than_10_m_behind_is_not_seen(seen, car):
    assert places(seen(car(2, 59, NORTH, 5), car(-2, 61, 90, 5))) == [(2, 59)]


def test_who_is_200_m_away_is_not_seen(seen, car):
    assert places(seen(car(2, -149, NORTH, 5))) == [(2, -100)]
    assert places(seen(car(2, -151, NORTH, 5))) == []


@pytest.mark.parametrize("rows", [2, 3, 12])
def test_the_nearest_are_seen_if_not_all_can_be(rows, seen, car):
    others = [car(2, 50 - gap, NORTH, 5) for gap in (30, 10, 20)]
    found = seen(*others, options=Options(observed_vehicles=rows))
    assert found.shape == (rows, 7)
    assert places(found) == [(2, 40), (2, 30), (2, 20)][: rows - 1]


def test_in_canonical_mode_ties_are_broken_by_the_list(seen, car):
    # both on one crossing lane, so equally far along the ego's, but for rounding
    for shift in (HAIR, -HAIR):
        others = [car(-20, 2 - shift, EAST, 5), car(-30, 2, EAST, 5), car(2, 20, NORTH, 5)]
        listed = [(2, 20), (-20, 2), (-30, 2)]
        assert places(seen(*others, options=Options(canonical=True))) == listed
        rounded = listed if shift < 0 else [listed[0], listed[2], listed[1]]
        assert places(seen(*others)) == rounded


def test_canonical_mode_keeps_other_orders(seen, car):
    others = [car(-20, 1.99, EAST, 5), car(-30, 2, EAST, 5)]
    assert places(seen(*others, options=Options(canonical=True))) == [(-30, 2), (-20, 2)]


@pytest.fixture(scope="module")
def outcomes():
    """The endings' counts in 200 first episodes of canonical mode and without, and the views."""

    def play(canonical):
        batch, ending, views = (
            Intersection(Options(canonical=canonical)).batch(200),
            np.zeros(200, int),
            [],
        )
        views.append(batch.reset(0))
        while (running := ending == Ending.NONE).any():
            views.append(batch.step(np.full(200, 2), auto_reset=False, rows=running).observation)
            ending[running] = batch.buffers.ending[running]
        return np.bincount(ending, minlength=4), views

    return play


def test_canonical_episodes_repeat_themselves_and_end_like_the_others(outcomes):
    (counts, views), (_, again), (default, other) = map(outcomes, (True, True, False))
    assert len(views) == len(again)
    for one, same in zip(views, again, strict=True):
        np.testing.assert_array_equal(one, same)
    assert abs(counts - default).max() <= 20
    assert any((one != another).any() for one, another in zip(views, other, strict=False))
