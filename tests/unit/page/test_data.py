"""The 7x7 world on the page: its front is exact, and its visits are those of its policies."""

import numpy as np
import pytest

from socialiq.evaluation.exact import Optimum
from socialiq.page.data import ANGLES, STORY_SEED, crossing, late_shares, story
from socialiq.social.angle import exact_weights
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid


@pytest.fixture(scope="module")
def best():
    return Optimum(tabulate(make_grid("crossing7")).reachable_part()).attainable


def corner_at(angle):
    found = crossing()
    return found["corners"][found["best"][angle]]


def test_the_published_angles_of_the_optima():
    assert corner_at(0)["angle"] == pytest.approx(-42.27, abs=0.005)
    assert corner_at(45)["angle"] == pytest.approx(10.03, abs=0.005)
    assert corner_at(90)["angle"] == pytest.approx(152.12, abs=0.005)


def test_each_angle_has_the_best_value_at_it(best):
    for angle in ANGLES:
        value = float(np.dot(exact_weights(float(angle)), corner_at(angle)["point"]))
        assert value == pytest.approx(best.optimum(float(angle)).value, abs=1e-8)
        assert corner_at(angle)["low"] - 1e-6 <= angle <= corner_at(angle)["high"] + 1e-6


def test_the_point_at_an_angle_is_within_the_polygon_and_below_the_optimum(best):
    for angle in (0, 30, 60, 90):
        radius = crossing()["radius"][angle]
        assert radius == pytest.approx(best.radius(float(angle)))
        assert radius <= best.optimum(float(angle)).value + 1e-9


def test_visits_add_up():
    for corner in crossing()["corners"]:
        decisions = np.array(corner["decisions"])
        assert decisions.sum() == pytest.approx(corner["length"], abs=1e-4)
        assert np.allclose(np.sum(corner["approaching"], axis=0), decisions[2], atol=1e-4)
        assert corner["arrival"] + corner["timeout"] == pytest.approx(1.0)


def test_the_egoist_never_stops_and_the_altruist_stops_to_the_end():
    assert corner_at(0)["decisions"][2] == [0.0, 0.0, 1.0]
    assert corner_at(90)["decisions"][2] == [24.0, 0.0, 0.0]


def test_at_45_degrees_it_stops_only_for_a_vehicle_in_the_cell_before():
    far, _, near, none = corner_at(45)["approaching"]
    assert near[0] > 1.0 and near[1:] == [0.0, 0.0]
    assert far[0] == none[0] == 0.0


def test_the_price_of_the_story_is_that_of_the_docs():
    caused, near = story(shipped=True)["price"]
    delays = [[round(point["delay"][0]) for point in line["points"]] for line in (caused, near)]
    assert delays == [[4, 3, 2, 3, 3, 3, 4], [5, 4, 3, 3, 5, 17, 58]]
    assert caused["points"][0]["kept"] == 1.0 and 0.88 < caused["points"][-1]["kept"] < 0.89
    assert story(shipped=False) == {"main": 0, "other": None, "seed": STORY_SEED, "price": []}


def test_the_shares_of_collisions_by_latency_are_those_of_the_docs():
    assert late_shares() == [0.008, 0.355, 0.03]
