"""Ways by time, against a search through all of them."""

import numpy as np
import pytest

from socialiq_recordings.conflicts.ways import InTime, Way
from socialiq_recordings.road.paths import Polyline


def seen(track: int, first: int, frames: int) -> Way:
    line = Polyline(np.array([[0.0, 0.0], [1.0, 0.0]]))
    return Way(track, first, line, np.zeros(frames), np.zeros(frames), 4.5, 1.8, (), 0.1)


@pytest.fixture
def ways():
    rng = np.random.default_rng(0)
    lengths = rng.integers(1, 40, 60).tolist()
    return {n: seen(n, int(rng.integers(0, 300)), size) for n, size in enumerate(lengths)}


def test_those_seen_in_an_interval_are_found_in_their_order(ways):
    in_time = InTime(ways)
    for first, last in ((-50, -1), (0, 300), (100, 100), (120.5, 160.0), (400, 500)):
        wanted = [way for way in ways.values() if way.first <= last and way.last >= first]
        assert in_time.between(first, last) == wanted
    assert in_time.longest == max(len(way.along) for way in ways.values())


def test_earlier_ones_come_the_latest_first(ways):
    firsts = [way.first for way in InTime(ways).earlier(150)]
    assert firsts == sorted((way.first for way in ways.values() if way.first <= 150), reverse=True)


def test_no_way_is_seen_where_there_is_none():
    assert InTime({}).between(0, 10) == [] and list(InTime({}).earlier(10)) == []
