"""Twenty lanes: coordinates along them, their connections, and the closest lane."""

import math

import numba
import numpy as np
import pytest

from socialiq.worlds.highway.core import geometry as shared
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.intersection.core.geometry import (
    LANES,
    LEFT,
    N_LANES,
    RIGHT,
    ROAD,
    ROUTES,
    STRAIGHT,
)

POSES = 2000
QUARTER = math.pi / 2


@numba.njit
def projected(along, aside):
    """x, y, heading, coordinate, offset of points beside every lane, and whether they're on it."""
    found = np.empty((N_LANES, len(along), 6))
    for number in range(N_LANES):
        lane = LANES[number]
        for place in range(len(along)):
            distance = along[place] * lane.length
            x, y = shared.position(lane, distance)
            heading = shared.heading_at(lane, distance)
            x -= aside[place] * math.sin(heading)
            y += aside[place] * math.cos(heading)
            found[number, place, 0], found[number, place, 1] = x, y
            found[number, place, 2] = heading
            found[number, place, 3] = shared.longitudinal(lane, x, y)
            found[number, place, 4] = shared.lateral(lane, x, y)
            found[number, place, 5] = shared.on_lane(lane, x, y, 0.0)
    return found


@numba.njit
def closest(poses, tie):
    """The closest lane of every pose, by every guess."""
    found = np.empty((len(poses), N_LANES), np.int64)
    for row in range(len(poses)):
        x, y, heading = poses[row]
        for guess in range(N_LANES):
            found[row, guess] = shared.closest_lane(LANES, x, y, heading, guess, tie)
    return found


def wrapped(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


def misfit(lane, poses):
    """Sideways, beyond the ends, and radians: by complex numbers, for comparison."""
    points, start = poses[:, 0] + 1j * poses[:, 1], complex(lane["x"], lane["y"])
    if lane["straight"]:
        seen = (points - start) * np.exp(-1j * lane["heading"])
        along, aside, heading = seen.real, np.abs(seen.imag), lane["heading"]
    else:
        seen = (points - start) * np.exp(-1j * lane["phase"])
        along = lane["sense"] * np.angle(seen) * lane["radius"]
        aside = np.abs(lane["radius"] - np.abs(seen))
        heading = lane["phase"] + lane["sense"] * (along / lane["radius"] + QUARTER)
    beyond = np.maximum(along - lane["length"], 0) + np.maximum(-along, 0)
    return aside + beyond + np.abs(wrapped(poses[:, 2] - heading))


@pytest.fixture(scope="module")
def points():
    return projected(np.array([0.0, 0.1, 0.5, 0.9, 1.0]), np.zeros(5))


@pytest.fixture(scope="module")
def poses():
    """A third anywhere, the others near a lane, as vehicles are."""
    rng = np.random.default_rng(0)
    anywhere = rng.uniform([-130, -130, -4], [130, 130, 4], (POSES // 4, 3))
    middle = rng.uniform([-20, -20, -4], [20, 20, 4], (POSES // 4, 3))
    along, aside = rng.uniform(-0.05, 1.05, POSES // 40), rng.normal(0, 1, POSES // 40)
    near = projected(along, aside)[..., :3].reshape(-1, 3)
    near[:, 2] += rng.normal(0, 0.3, len(near)) + 2 * math.pi * rng.integers(-1, 2, len(near))
    return np.concatenate([anywhere, middle, near])


def test_a_lanes_own_points_come_back(points):
    for lane, found in zip(LANES, points, strict=True):
        expected = np.array([0.0, 0.1, 0.5, 0.9, 1.0]) * lane["length"]
        np.testing.assert_allclose(found[:, 3], expected, atol=1e-12)
        np.testing.assert_allclose(found[:, 4], 0.0, atol=1e-12)


def test_offsets_are_positive_to_the_right():
    for aside in (-1.5, 1.5):
        np.testing.assert_allclose(projected(np.array([0.5]), np.array([aside]))[..., 4], aside)


def test_a_lane_is_4_m_wide_and_lengthened_by_a_vehicle():
    fractions, on = np.array([0.5, 0.5, 0.5, 0.5]), [True, False, True, False]
    found = projected(fractions, np.array([1.99, 2.01, -1.99, -2.01]))[..., 5]
    assert (found == on).all()
    for lane, record in enumerate(LANES):
        ends = 1 + np.array([4.9, 5.1]) / record["length"]
        beyond = np.concatenate([ends, 1 - ends])
        assert projected(beyond, np.zeros(4))[lane, :, 5].tolist() == on


def test_the_southern_arms_lanes_lie_where_the_map_says(points):
    start, end = points[:, 0, :2], points[:, -1, :2]
    ends = {
        APPROACH: [(2, 111), (2, 11)],
        RIGHT: [(2, 11), (11, 2)],
        LEFT: [(2, 11), (-11, -2)],
        STRAIGHT: [(2, 11), (2, -11)],
        EXIT: [(11, 2), (111, 2)],
    }
    for lane, expected in ends.items():
        np.testing.assert_allclose([start[lane], end[lane]], expected, atol=1e-12)
    lengths = [100, 9 * QUARTER, 13 * QUARTER, 22, 100]
    np.testing.assert_allclose(LANES["length"][:5], lengths, rtol=1e-12)


def test_arms_are_quarter_turns_of_the_southern_one(points):
    turned = points[:5, :, 0] + 1j * points[:5, :, 1]
    for corner in range(4):
        found = points[5 * corner : 5 * corner + 5]
        np.testing.assert_allclose(found[..., 0] + 1j * found[..., 1], turned, atol=1e-12)
        turned = turned * 1j  # y grows to the south, so this is clockwise: south, west, north
    assert LANES["priority"].reshape(4, 5).tolist() == [[1, 1, 0, 1, 1], [3, 3, 2, 3, 3]] * 2


def test_routes_are_joined(points):
    for origin in range(4):
        for destination in {0, 1, 2, 3} - {origin}:
            assert ROUTES[origin, destination, 3:].tolist() == [-1, -1, -1]
            before, across, after = ROUTES[origin, destination, :3]
            for lane, following in ((before, across), (across, after)):
                end, start = points[lane, -1], points[following, 0]
                np.testing.assert_allclose(end[:2], start[:2], atol=1e-12)
                assert wrapped(end[2] - start[2]) == pytest.approx(0, abs=1e-12)
            entrance, way_out = points[5 * destination, 0], points[after, -1]
            # the way out ends 4 m beside the entrance of the same arm, going the other way
            assert math.dist(entrance[:2], way_out[:2]) == pytest.approx(4)
            assert abs(wrapped(entrance[2] - way_out[2])) == pytest.approx(math.pi)


def test_connected_lanes_begin_where_the_lane_ends_or_end_where_it_begins(points):
    for lane in range(N_LANES):
        connected = ROAD.connected[lane]
        number = (connected["lane"] >= 0).sum()
        assert number == {APPROACH: 5, EXIT: 5}.get(lane % 5, 3)
        assert connected[0].tolist() == (lane, 0.0)
        for place in range(1, number):
            other, shift = connected[place]
            first, second = (lane, other) if shift > 0 else (other, lane)
            assert abs(shift) == LANES["length"][first]
            # from an exit to the approach of the same arm it's 4 m to the side
            apart = 4 if first % 5 == EXIT else 0
            joint = points[first, -1, :2], points[second, 0, :2]
            assert math.dist(*joint) == pytest.approx(apart, abs=1e-9)


def test_points_on_a_lane_are_closest_to_it(points):
    for lane in range(N_LANES):
        assert (closest(points[lane, 1:-1, :3].copy(), 0.0) == lane).all()


@pytest.mark.parametrize("tie", [0.0, 1e-9])
def test_the_closest_lane_depends_on_no_guess(poses, tie):
    found = closest(poses, tie)
    assert (found == found[:, :1]).all()


def test_the_closest_lane_has_the_least_misfit(poses):
    misfits = np.stack([misfit(lane, poses) for lane in LANES], axis=1)
    found = closest(poses, 0.0)[:, 0]
    least = misfits[np.arange(len(poses)), found]
    np.testing.assert_allclose(least, misfits.min(axis=1), atol=1e-9)
    assert len(set(found.tolist())) == N_LANES


def test_of_equally_close_lanes_the_first_counts():
    # at the stop line the approach ends and three lanes begin
    assert (closest(np.array([[2.0, 11.0, -QUARTER]]), 1e-9) == APPROACH).all()
