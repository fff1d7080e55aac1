"""Physics against known points of the equations; both forms of each function have the same bits."""

import math

import numpy as np
import pytest

from socialiq import physics
from socialiq.worlds.highway.core.compile import for_python


def test_angles_are_wrapped_in_radians_and_in_degrees():
    assert physics.wrapped(3.5 * math.pi) == pytest.approx(-0.5 * math.pi)
    assert physics.wrapped(np.array([-190.0, 180.0, 540.0]), 180.0).tolist() == [170, -180, -180]
    headings = physics.wrapped_heading(np.array([0.1, math.pi, -math.pi, 7.0]))
    assert headings.tolist() == [0.1, math.pi, math.pi, pytest.approx(7.0 - 2 * math.pi)]


def test_the_desired_gap_and_the_acceleration_by_hand():
    # s = 12 m, v = 10 m/s, 5 m/s faster, a b = 4 (m/s²)²: 12 + 10 * 5 / (2 * 2)
    assert physics.desired_gap(12.0, 10.0, 5.0, 1.0, 4.0) == 24.5
    assert physics.desired_gap(12.0, 10.0, -8.0, 1.0, 4.0) == -8.0  # without a limit
    assert physics.idm(0.75, 0.5, 2.0) == 1.0  # 2 (0.75 - 0.5²)


def test_a_step_of_constant_acceleration():
    driven, after = physics.ballistic(np.array([10.0, 2.0]), np.array([2.0, -4.0]), 1.0)
    assert driven.tolist() == [11.0, 0.5] and after.tolist() == [12.0, 0.0]


@pytest.mark.parametrize(
    ("x", "y", "degrees", "depth"),
    [
        (3.9, 0.0, 0, 0.1),
        (4.1, 0.0, 0, -0.1),
        (0.0, 1.9, 0, 0.1),
        (0.0, 2.1, 0, -0.1),
        (2.9, 0.0, 90, 0.1),
        (3.1, 0.0, 90, -0.1),
        (3.5, 1.9, 45, 2 + 3 * math.sqrt(0.5) - 5.4 * math.sqrt(0.5)),
        # The boxes around them overlap, they don't: along its own long axis 2 + 3 / sqrt(2) m.
        (3.9, 2.9, 45, 2 + 3 * math.sqrt(0.5) - 6.8 * math.sqrt(0.5)),
    ],
)
def test_the_depth_of_two_rectangles_of_4_by_2_m(x, y, degrees, depth):
    heading, sizes = math.radians(degrees), (2.0, 1.0, 2.0, 1.0)
    assert physics.overlap_depth(x, y, 0.0, heading, *sizes) == pytest.approx(depth)
    assert physics.overlap_depth(-x, -y, heading, 0.0, *sizes) == pytest.approx(depth)


def test_corners_of_a_rectangle():
    corners = physics.corners((1.0, 2.0), math.pi / 2, 4.0, 2.0)
    np.testing.assert_allclose(corners, [[0, 4], [2, 4], [2, 0], [0, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("wrapped", [-20.0], [20.0]),
        ("desired_gap", [0.0, 0.0, -20.0, 0.5, 0.5], [40.0, 20.0, 20.0, 4.0, 5.0]),
        ("idm", [-1.0, -3.0, 0.5], [1.0, 3.0, 4.0]),
        ("ballistic", [0.0, -8.0, 0.1], [20.0, 4.0, 1.0]),
    ],
)
def test_compiled_forms_have_the_bits_of_arrays(name, low, high):
    function = getattr(physics, name)
    compiled = for_python(function)
    columns = np.random.default_rng(0).uniform(low, high, (2000, len(low))).T
    results = np.atleast_2d(function(*columns))
    expected = [np.atleast_1d(compiled(*row)).tolist() for row in columns.T.tolist()]
    assert results.T.tolist() == expected
