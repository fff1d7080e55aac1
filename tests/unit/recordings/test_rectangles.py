"""Two rectangles of 4 x 2 m, by hand."""

import numpy as np
import pytest

from socialiq_recordings.rectangles import touching


def touch(x, y, degrees=0.0, moved=(0.0, 0.0)):
    return bool(
        touching(
            np.array([[[0.0, 0.0], [x, y]]]),
            np.array([[0.0, np.radians(degrees)]]),
            np.array([[[4.0, 2.0], [4.0, 2.0]]]),
            np.array([[[0.0, 0.0], moved]]),
        )[0]
    )


@pytest.mark.parametrize(
    ("x", "y", "degrees", "expected"),
    [
        (3.9, 0.0, 0, True),
        (4.1, 0.0, 0, False),
        (0.0, 1.9, 0, True),
        (0.0, 2.1, 0, False),
        (2.9, 0.0, 90, True),
        (3.1, 0.0, 90, False),
        (3.5, 1.9, 45, True),
        (3.9, 2.9, 45, False),  # the boxes around them overlap, they don't
    ],
)
def test_they_overlap(x, y, degrees, expected):
    assert touch(x, y, degrees) == expected


def test_they_will_overlap_on_their_way():
    assert touch(6.0, 0.0, moved=(-2.1, 0.0))
    assert not touch(6.0, 0.0, moved=(-1.9, 0.0))
    assert touch(6.0, 0.0, moved=(-12.0, 0.0))  # through and out again
    assert not touch(6.0, 0.0, moved=(5.0, 0.0))
