"""Two rectangles of 4 x 2 m, by hand."""

import numpy as np
import pytest

from socialiq_recordings.physics import overlaps
from socialiq_recordings.world.observation import overlap


def touch(x, y, degrees=0.0):
    return bool(overlap(x, y, 0.0, np.radians(degrees), 2.0, 1.0, 2.0, 1.0))


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


def test_the_depth_of_an_overlap_of_tracks(straight):
    tracks = straight([8.0, 8.0], frames=2, apart=1.5)
    pairs = overlaps(tracks)
    assert pairs.first.tolist() == [0, 1] and pairs.second.tolist() == [2, 3]
    assert pairs.depth == pytest.approx([0.3, 0.3])  # 1.8 m wide, 1.5 m apart
    assert not len(overlaps(straight([8.0, 8.0], frames=2, apart=2.0)).depth)
