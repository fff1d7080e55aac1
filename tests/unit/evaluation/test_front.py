"""Angles at which each policy is the best: by hand, against a search, against the front's."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from socialiq.errors import UserError
from socialiq.evaluation.front import (
    hypervolume,
    support_intervals,
)
from socialiq.mdp.front import AttainableSet

TABLE_A1 = {"ego": (7.13, -2.00), "pro": (4.88, 0.68), "alt": (0.01, 1.76)}


coordinates = st.integers(-4, 4).map(float)


clouds = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=7)


def named(points):
    return {f"p{number}": point for number, point in enumerate(points)}


def test_the_thesis_three_points_by_hand():
    # Between two points the normal of their chord: atan(2.25 / 2.68) and atan(4.87 / 1.08). The
    # longest chord closes the hull below, with the normal (-3.76, -7.12).
    found = support_intervals(TABLE_A1)
    first, second = np.degrees(np.arctan([2.25 / 2.68, 4.87 / 1.08]))
    below = np.degrees(np.arctan2(-7.12, -3.76))
    assert found["ego"] == pytest.approx((below, first))
    assert found["pro"] == pytest.approx((first, second))
    assert found["alt"] == pytest.approx((second, below + 360.0))
    assert (first, second) == pytest.approx((40.0, 77.5), abs=0.05)


def test_one_point_is_the_best_everywhere():
    assert support_intervals({"a": (3.0, 1.0)}) == {"a": (-180.0, 180.0)}
    assert support_intervals({"a": (3.0, 1.0), "b": (3.0, 1.0)}) == {
        "a": (-180.0, 180.0),
        "b": (-180.0, 180.0),
    }


def test_two_points_share_the_circle():
    assert support_intervals({"a": (1.0, 0.0), "b": (0.0, 0.0)}) == {
        "a": (-90.0, 90.0),
        "b": (90.0, 270.0),
    }
    found = support_intervals({"up": (0.0, 1.0), "down": (0.0, 0.0)})
    assert found == {"up": (0.0, 180.0), "down": (180.0, 360.0)}


def test_points_inside_an_edge_or_the_hull_are_the_best_nowhere():
    corners = {"a": (2.0, 0.0), "b": (0.0, 2.0), "c": (0.0, 0.0)}
    inside = {"middle": (1.0, 1.0), "third": (0.6, 1.4), "within": (0.5, 0.5)}
    found = support_intervals({**corners, **inside})
    assert {name for name, interval in found.items() if interval is None} == set(inside)
    assert {name: found[name] for name in corners} == support_intervals(corners)
    line = support_intervals({"a": (0.0, 0.0), "b": (1.0, 1.0), "c": (2.0, 2.0)})
    assert line == {"a": (135.0, 315.0), "b": None, "c": (-45.0, 135.0)}


def test_equal_points_have_equal_intervals():
    twice = support_intervals({**TABLE_A1, "again": TABLE_A1["pro"]})
    assert twice["again"] == twice["pro"] == support_intervals(TABLE_A1)["pro"]


@given(clouds)
def test_the_intervals_cover_the_circle_once(points):
    found = support_intervals(named(points))
    distinct = {points[int(name[1:])]: interval for name, interval in found.items() if interval}
    assert sum(high - low for low, high in distinct.values()) == pytest.approx(360.0)
    if len(set(points)) > 1:
        assert all(-180.0 < low <= 180.0 and low < high for low, high in distinct.values())


@given(clouds, st.floats(-180, 180))
def test_who_is_the_best_at_an_angle_supports_it(points, angle):
    cloud = named(points)
    values = np.array(points) @ [np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))]
    found = support_intervals(cloud)
    for number, name in enumerate(cloud):
        low, high = found[name] or (np.nan, np.nan)
        within = any(low + 1e-6 < angle + turn < high - 1e-6 for turn in (0.0, 360.0))
        if within:
            assert values[number] == pytest.approx(values.max(), abs=1e-9)


def test_they_are_the_intervals_of_the_front():
    points = np.random.default_rng(1).normal(size=(30, 2))
    corners = ConvexHull(points).vertices
    polygon = AttainableSet(points[corners])
    found = support_intervals(named(points.tolist()))
    assert {name for name, one in found.items() if one} == {f"p{corner}" for corner in corners}
    for vertex, corner in enumerate(corners):
        expected = polygon.supporting_interval(vertex)
        assert found[f"p{corner}"] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("points", [{}, {"a": (np.nan, 0.0)}])
def test_nothing_and_not_finite_have_no_support(points):
    with pytest.raises(UserError, match="at least one policy is needed"):
        support_intervals(points)


CORNER = np.zeros(2)


POINTS = st.lists(st.tuples(st.integers(-3, 12), st.integers(-3, 12)), min_size=1, max_size=8).map(
    lambda rows: np.array(rows, float)
)


def test_two_steps_of_a_stair():
    assert hypervolume(np.array([[2.0, 1.0], [1.0, 3.0]]), CORNER) == pytest.approx(2.0 + 2.0)


def test_what_does_not_beat_the_corner_counts_for_nothing():
    assert hypervolume(np.array([[5.0, -1.0], [0.0, 9.0]]), CORNER) == 0.0


@given(POINTS)
def test_it_is_the_number_of_cells_below_a_point(points):
    cells = [
        any(x < env and y < social for env, social in points) for x in range(12) for y in range(12)
    ]
    assert hypervolume(points, CORNER) == pytest.approx(sum(cells))


@given(POINTS)
def test_a_dominated_point_adds_nothing(points):
    more = np.vstack([points, points[:1] - 1.0])
    assert hypervolume(more, CORNER) == pytest.approx(hypervolume(points, CORNER))


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(UserError, match="finite"):
        hypervolume(np.array([[np.nan, 1.0]]), CORNER)


def test_it_is_that_of_another_library():
    """The file is written by benchmarks/peers/hypervolume.py with morl-baselines."""
    cases = json.loads(Path(__file__).with_name("hypervolumes_by_morl_baselines.json").read_text())
    assert len(cases) == 20
    for case in cases:
        area = hypervolume(np.array(case["points"]), np.array(case["reference"]))
        assert area == pytest.approx(case["hypervolume"], rel=1e-9, abs=1e-9)
