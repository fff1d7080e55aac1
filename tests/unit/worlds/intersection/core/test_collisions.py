"""Rectangles that overlap or soon will: crashes, pushes, and contacts."""

import math

import numpy as np
import pytest

from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.core.vehicle import collide as collide_kernel
from socialiq.worlds.highway.options import EPISODE, VEHICLE, Contact

DT = 0.1
NORTH, EAST = -90.0, 0.0
STRUCK, WAS_STRUCK = Contact.EGO_STRUCK, Contact.EGO_WAS_STRUCK
NOTHING = Contact.NONE, -1

collide = for_python(collide_kernel)


def collided(*cars, ego=0, contact=NOTHING):
    """Cars, numbered from 10, after a sub-step's collisions; the ego's contact and its partner."""
    vehicles = np.array([one[()] for one in cars], VEHICLE)
    vehicles["identity"] = 10 + np.arange(len(cars))
    vehicles["agent"] = np.where(np.arange(len(cars)) == ego, 0, -1)
    episodes = np.zeros(1, EPISODE).view(np.recarray)
    episodes.vehicles, episodes.controlled[:, 0] = len(cars), ego
    episodes.contact[:, 0], episodes.touched[:, 0] = contact
    collide(episodes[0], vehicles, len(cars), 1, DT, 0.0)
    return vehicles, (Contact(episodes.contact[0, 0]), episodes.touched[0, 0])


def pushes(vehicles):
    return np.stack([vehicles["push_x"], vehicles["push_y"]], axis=1)


def test_a_follower_that_runs_into_the_ego_struck_it(car):
    for ego, behind in ((0, 1), (1, 0)):
        cars = [car(2, 50, NORTH, 1), car(2, 54.9, NORTH, 5)]
        vehicles, contact = collided(cars[ego], cars[behind], ego=ego)
        assert contact == (WAS_STRUCK, 10 + behind)
        assert vehicles["crashed"].all() and vehicles["pushed"].all()
        # 0.1 m of overlap and 0.4 m of approach: each is pushed by half of it
        np.testing.assert_allclose(pushes(vehicles)[ego], [0, -0.25], atol=1e-12)
        np.testing.assert_allclose(pushes(vehicles)[behind], [0, 0.25], atol=1e-12)


def test_the_ego_strikes_the_side_of_a_crossing_car(car):
    vehicles, contact = collided(car(2, 3.4, NORTH, 5), car(2, 0, EAST, 5))
    assert contact == (STRUCK, 11)
    assert vehicles["crashed"].all()
    # its front is 0.1 m inside, and gets 0.5 m further
    np.testing.assert_allclose(pushes(vehicles), [[0, 0.3], [0, -0.3]], atol=1e-12)


def test_a_crossing_car_strikes_the_egos_side(car):
    _, contact = collided(car(2, 0, NORTH, 5), car(-1.4, 0, EAST, 5))
    assert contact == (WAS_STRUCK, 11)


def test_of_equal_motions_the_ego_is_to_blame(car):
    _, contact = collided(car(2, 4.9, NORTH, 5), car(2, 0, -NORTH, 5))
    assert contact == (STRUCK, 11)


def test_who_will_touch_is_pushed_now_and_crashes_later(car):
    vehicles, contact = collided(car(2, 5.2, NORTH, 5), car(2, 0, NORTH, 0))
    assert contact == (STRUCK, 11)
    assert vehicles["pushed"].all() and not vehicles["crashed"].any()
    np.testing.assert_allclose(pushes(vehicles), [[0, 0.15], [0, -0.15]], atol=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "degrees"),
    [(4.1, 0, NORTH), (2, 5.1, NORTH), (2, 3.6, EAST), (5.2, 4.2, 45.0), (2, -5.1, NORTH)],
)
def test_cars_apart_are_left_alone(x, y, degrees, car):
    vehicles, contact = collided(car(2, 0, NORTH, 0), car(x, y, degrees, 0))
    assert contact == NOTHING
    assert not vehicles["crashed"].any() and not vehicles["pushed"].any()
    assert not pushes(vehicles).any()


def test_the_last_push_counts(car):
    # bumper to bumper: the one in the middle is pushed forwards, then back
    row = [car(2, y, NORTH, 0) for y in (4.8, 0, -4.9)]
    vehicles, contact = collided(*row, ego=-1)
    np.testing.assert_allclose(pushes(vehicles), [[0, 0.1], [0, 0.05], [0, -0.05]], atol=1e-12)
    assert vehicles["crashed"].all() and contact == NOTHING


def test_a_contact_stays_until_there_is_another(car):
    ego, far, near = car(2, 0, NORTH, 5), car(2, 50, NORTH, 5), car(2, 4.9, NORTH, 9)
    before = STRUCK, 7
    assert collided(ego, far, contact=before)[1] == before
    assert collided(ego, near, contact=before)[1] == (WAS_STRUCK, 11)
    assert collided(ego, far, near, contact=before)[1] == (WAS_STRUCK, 12)
    ego["crashed"] = True
    assert collided(ego, near, contact=before)[1] == before


def test_others_collisions_are_no_contact_of_the_ego(car):
    cars = [car(2, 50, NORTH, 5), car(2, 0, NORTH, 5), car(2, 4.9, NORTH, 9)]
    vehicles, contact = collided(*cars)
    assert vehicles["crashed"].tolist() == [False, True, True]
    assert contact == NOTHING


def sampled(vehicle, reserve):
    """Points of a rectangle that is smaller by a reserve on every side."""
    along, across = np.meshgrid(
        np.linspace(-1, 1, 41) * (2.5 - reserve), np.linspace(-1, 1, 17) * (1 - reserve)
    )
    turned = np.exp(1j * vehicle["heading"]) * (along + 1j * across)
    return turned.ravel() + complex(vehicle["x"], vehicle["y"])


def inside(points, vehicle, reserve):
    seen = (points - complex(vehicle["x"], vehicle["y"])) * np.exp(-1j * vehicle["heading"])
    return ((np.abs(seen.real) <= 2.5 - reserve) & (np.abs(seen.imag) <= 1 - reserve)).any()


def test_overlaps_are_those_of_sampled_points_and_a_push_ends_them(car):
    rng, met = np.random.default_rng(0), 0
    for _ in range(400):
        x, y = rng.uniform(-5, 5, 2)
        pair = [car(0, 0, rng.uniform(0, 360), 0), car(x, y, rng.uniform(0, 360), 0)]
        vehicles, _ = collided(*pair)
        one, other = vehicles
        met += one["crashed"]
        assert one["crashed"] == other["crashed"] == one["pushed"] == other["pushed"]
        if inside(sampled(one, 0.0), other, 0.0):
            assert one["crashed"]
        if one["crashed"]:
            # the grid is 0.125 m wide: with so much more all around, it can't miss
            assert inside(sampled(one, -0.1), other, -0.1)
        np.testing.assert_array_equal(*(pushes(vehicles) * [[1, 1], [-1, -1]]))
        for vehicle in pair:
            moved = vehicles[0] if vehicle is pair[0] else vehicles[1]
            vehicle["x"] += moved["push_x"] * (1 + 1e-6)
            vehicle["y"] += moved["push_y"] * (1 + 1e-6)
        assert not collided(*pair)[0]["crashed"].any()
        length = math.hypot(*pushes(vehicles)[0])
        if one["crashed"] and length > 0.05:  # nor is a shorter one enough
            for vehicle, moved in zip(pair, vehicles, strict=True):
                vehicle["x"] -= moved["push_x"] * 0.01
                vehicle["y"] -= moved["push_y"] * 0.01
            assert collided(*pair)[0]["crashed"].all()
    assert 100 < met < 300
