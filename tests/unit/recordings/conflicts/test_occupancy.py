"""Times in an area: recorded, projected, and the time between two."""

import math

import numpy as np

from socialiq_recordings.conflicts.ways import (
    Occupancy,
    Way,
    apart,
    expected,
    projected,
    recorded,
)
from socialiq_recordings.road.paths import Polyline


def way(along, speed=10.0, first=0):
    along = np.array(along, np.float64)
    line = Polyline(np.array([[0.0, 0.0], [200.0, 0.0]]))
    return Way(0, first, line, along, np.full(len(along), speed), 4.0, 2.0, (), 0.5)


def test_recorded_times_are_those_of_the_bumpers():
    # 5 m a frame from 10 m on; the front arrives at 30 with the middle at 28, frame 3.6.
    moving = way(10.0 + 5.0 * np.arange(10))
    assert recorded(moving, 30.0, 40.0) == Occupancy(3.6 * 0.5, 6.4 * 0.5)
    assert recorded(way(10.0 + 5.0 * np.arange(10), first=4), 30.0, 40.0) == (7.6 / 2, 10.4 / 2)


def test_what_was_not_seen_is_infinite():
    moving = way(10.0 + 5.0 * np.arange(3))
    assert recorded(moving, 5.0, 18.0) == Occupancy(-math.inf, 2 * 0.5)
    assert recorded(moving, 15.0, 60.0) == Occupancy(0.6 * 0.5, math.inf)


def test_projection_keeps_the_speed_and_the_past():
    moving = way(10.0 + 5.0 * np.arange(3))
    assert projected(moving, 15.0, 38.0, 2) == Occupancy(0.3, 1.0 + 2.0)
    assert projected(way([10.0, 10.0], speed=0.0), 30.0, 40.0, 1) == (math.inf, math.inf)
    assert expected(moving, 15.0, 38.0) == Occupancy(0.3, 3.0)


def test_time_between_two():
    assert apart(Occupancy(1.0, 2.0), Occupancy(3.5, 4.0)) == 1.5
    assert apart(Occupancy(3.5, 4.0), Occupancy(1.0, 2.0)) == 1.5
    assert apart(Occupancy(1.0, 3.0), Occupancy(2.0, 4.0)) == 0.0
    assert apart(Occupancy(1.0, 3.0), Occupancy(math.inf, math.inf)) == math.inf
    # Minus infinity: it was in the area at its first frame, or had left it.
    assert apart(Occupancy(-math.inf, 1.0), Occupancy(3.0, 4.0)) == 2.0
    assert apart(Occupancy(-math.inf, -math.inf), Occupancy(3.0, 4.0)) == math.inf
    assert apart(Occupancy(-math.inf, -math.inf), Occupancy(-math.inf, 4.0)) == math.inf
