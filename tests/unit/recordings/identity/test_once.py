"""Tracks and conflicts of overlapping recordings are counted once."""

import numpy as np

from socialiq_recordings.identity.identify import (
    Identified,
    Overlap,
    pairs_once,
    same_moments,
)


def identified(*overlaps):
    names = ("a", "b", "c")
    return Identified(names, names, names, overlaps, (np.zeros(0, np.int64),) * 3)


WINDOWS = identified(
    Overlap(0, 1, 2.0, 8.0, ((0, 1), (1, 0))),
    Overlap(0, 2, 0.0, float("nan"), ((0, 0),)),  # the same vehicle, at other moments
)


def test_only_common_moments_are_the_same():
    assert same_moments(WINDOWS) == {(0, 0): {(1, 1)}, (1, 1): {(0, 0)}, (0, 1): {(1, 0)}} | {
        (1, 0): {(0, 1)}
    }


def test_the_longer_of_two_conflicts_stays():
    sizes = {(0, 0, 1): 3.0, (0, 1, 0): 3.0, (1, 1, 0): 5.0, (1, 0, 1): 2.0, (2, 0, 1): 1.0}
    # (0, 0, 1) and (1, 1, 0) are the same vehicles in the same roles.
    assert pairs_once(sizes, WINDOWS) == {(1, 1, 0), (0, 1, 0), (2, 0, 1)}
