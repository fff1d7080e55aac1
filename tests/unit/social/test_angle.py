import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from socialiq.errors import UserError
from socialiq.social.angle import (
    angle_difference,
    angle_of,
    check_angle,
    exact_weights,
    weights,
)

degrees = st.floats(-720, 720)


@pytest.mark.parametrize("angle", [0.0, 45.0, 359.999])
def test_an_angle_in_range_is_returned(angle: float) -> None:
    assert check_angle(angle) == angle


@pytest.mark.parametrize("angle", [-0.001, 360.0, 405.0, math.nan, math.inf, -math.inf])
def test_an_angle_out_of_range_is_refused(angle: float) -> None:
    with pytest.raises(UserError, match=r"outside \[0, 360\)"):
        check_angle(angle)


def test_weights_by_hand() -> None:
    assert weights(0.0) == (1.0, 0.0)
    assert weights(30.0) == pytest.approx((0.8660254037844387, 0.5), abs=1e-15)
    assert weights(45.0) == pytest.approx((0.7071067811865476, 0.7071067811865476), abs=1e-15)
    assert weights(225.0) == pytest.approx((-0.7071067811865476, -0.7071067811865476), abs=1e-15)


def test_weights_keep_the_residue_of_the_thesis_at_90_degrees() -> None:
    assert weights(90.0) == (6.123233995736766e-17, 1.0)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.0, (1.0, 0.0)), (90.0, (0.0, 1.0)), (180.0, (-1.0, 0.0)), (270.0, (0.0, -1.0))],
)
def test_exact_weights_are_exact_at_right_angles(
    angle: float, expected: tuple[float, float]
) -> None:
    assert exact_weights(angle) == expected


@pytest.mark.parametrize("angle", [1e-9, 30.0, 89.999, 90.001, 123.4])
def test_exact_weights_are_the_weights_elsewhere(angle: float) -> None:
    assert exact_weights(angle) == weights(angle)


@pytest.mark.parametrize(
    ("env", "social", "expected"),
    [
        (1.0, 0.0, 0.0),
        (2.0, 2.0, 45.0),
        (0.0, 3.0, 90.0),
        (-1.0, 0.0, 180.0),
        (0.0, -1.0, -90.0),
        (-math.sqrt(3.0), 1.0, 150.0),
    ],
)
def test_angle_of_by_hand(env: float, social: float, expected: float) -> None:
    assert angle_of(env, social) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("social", [-0.0, -1e-300])
def test_angle_of_never_gives_minus_180(social: float) -> None:
    assert angle_of(-1.0, social) == 180.0


@given(st.floats(0, 359.99), st.floats(1e-3, 1e3))
def test_angle_of_undoes_weights_at_any_length(angle: float, length: float) -> None:
    env, social = weights(angle)
    found = angle_of(length * env, length * social)
    assert -180.0 < found <= 180.0
    assert abs(angle_difference(found, angle)) < 1e-9


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [(10.0, 350.0, 20.0), (350.0, 10.0, -20.0), (-170.0, 170.0, 20.0), (180.0, 0.0, -180.0)],
)
def test_angle_difference_by_hand(a: float, b: float, expected: float) -> None:
    assert angle_difference(a, b) == expected


@given(degrees, degrees)
@example(float(np.nextafter(-180.0, -np.inf)), 0.0)
def test_angle_difference_is_wrapped_and_keeps_the_direction(a: float, b: float) -> None:
    difference = angle_difference(a, b)
    assert -180.0 <= difference < 180.0
    turns = (a - b - difference) / 360.0
    assert turns == pytest.approx(round(turns), abs=1e-9)
