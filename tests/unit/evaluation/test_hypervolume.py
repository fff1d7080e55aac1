"""The area that a family of policies dominates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialiq.errors import UserError
from socialiq.evaluation.hypervolume import hypervolume

CORNER = np.zeros(2)
POINTS = st.lists(st.tuples(st.integers(-3, 12), st.integers(-3, 12)), min_size=1, max_size=8).map(
    lambda rows: np.array(rows, float)
)


def test_two_steps_of_a_stair() -> None:
    assert hypervolume(np.array([[2.0, 1.0], [1.0, 3.0]]), CORNER) == pytest.approx(2.0 + 2.0)


def test_what_does_not_beat_the_corner_counts_for_nothing() -> None:
    assert hypervolume(np.array([[5.0, -1.0], [0.0, 9.0]]), CORNER) == 0.0


@given(POINTS)
def test_it_is_the_number_of_cells_below_a_point(points: np.ndarray) -> None:
    cells = [
        any(x < env and y < social for env, social in points) for x in range(12) for y in range(12)
    ]
    assert hypervolume(points, CORNER) == pytest.approx(sum(cells))


@given(POINTS)
def test_a_dominated_point_adds_nothing(points: np.ndarray) -> None:
    more = np.vstack([points, points[:1] - 1.0])
    assert hypervolume(more, CORNER) == pytest.approx(hypervolume(points, CORNER))


def test_points_that_are_not_finite_are_refused() -> None:
    with pytest.raises(UserError, match="finite"):
        hypervolume(np.array([[np.nan, 1.0]]), CORNER)
