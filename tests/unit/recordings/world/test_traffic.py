import math
from types import SimpleNamespace

import numpy as np
import pytest

from socialiq.worlds.highway.core.compile import for_python
from socialiq_recordings import idm as reference
from socialiq_recordings.world import traffic

DRIVER = reference.Idm(desired_speed=12.0)


@pytest.fixture(scope="module")
def waits():
    return for_python(traffic.waits)


@pytest.mark.parametrize("speed", [0.0, 3.0, 12.0, 20.0])
@pytest.mark.parametrize(("gap", "leader"), [(math.inf, 0.0), (5.0, 0.0), (0.05, 3.0), (40.0, 9.0)])
def test_the_compiled_idm_is_that_of_arrays(speed, gap, leader):
    compiled = traffic.idm(speed, gap, leader, *DRIVER)
    expected = reference.acceleration(speed, gap, leader, *DRIVER)
    assert compiled == pytest.approx(expected, abs=1e-12)


def test_the_time_for_a_distance():
    # From a stand with 2 m/s²: 9 m take 3 s. With at most 4 m/s: 2 s for 4 m, then 5 m at 4 m/s.
    assert traffic.time_to(9.0, 0.0, 2.0, 100.0) == pytest.approx(3.0)
    assert traffic.time_to(9.0, 0.0, 2.0, 4.0) == pytest.approx(2.0 + 5.0 / 4.0)
    assert traffic.time_to(10.0, 5.0, 2.0, 5.0) == pytest.approx(2.0)
    assert traffic.time_to(0.0, 5.0, 2.0, 5.0) == 0.0


# gap, through, speed, a, v0, margin, their gap, their way through, their speed, rule, ranked
FREE = (30.0, 40.0, 8.0, 1.5, 12.0, 1.5)


@pytest.mark.parametrize(
    ("theirs", "rule", "waiting"),
    [
        ((24.0, 34.0, 8.0), 1, True),  # it yields and they come at one time
        ((24.0, 34.0, 8.0), -1, False),  # the other yields
        ((16.0, 26.0, 8.0), 0, True),  # the other is first
        ((39.0, 49.0, 8.0), 0, False),  # it is first
        ((200.0, 210.0, 8.0), 1, False),  # the gap is long enough
        ((1.0, 11.0, 20.0), 1, False),  # the other is through before it arrives
        ((-2.0, 8.0, 0.0), -1, True),  # the other stands in the area
        ((-2.0, 1.0, 10.0), 1, False),  # the other is about to leave it
    ],
)
def test_who_waits_at_a_conflict_area(theirs, rule, waiting):
    assert traffic.waits(*FREE, *theirs, rule, True) == waiting


def test_who_cannot_stop_any_more_goes_on():
    assert not traffic.waits(2.0, 12.0, 12.0, 1.5, 12.0, 1.5, 10.0, 20.0, 8.0, 1, True)


def test_compiled_and_interpreted_rules_agree(waits):
    for gap in (5.0, 30.0):
        for their_gap in (-1.0, 20.0, 60.0):
            given = (gap, gap + 10, 8.0, 1.5, 12.0, 1.5, their_gap, their_gap + 9, 8.0, 0, False)
            assert waits(*given) == traffic.waits(*given)


def test_the_place_of_another_on_ones_way():
    road = SimpleNamespace(stretch_first=[0, 1], stretch=np.array([[10.0, 30.0, 50.0, 70.0]]))
    assert traffic.ahead_of(road, 0, 15.0, 40.0) == 55.0
    assert traffic.ahead_of(road, 0, 15.0, 60.0) == -math.inf  # behind
    assert traffic.ahead_of(road, 0, 31.0, 40.0) == -math.inf  # not in the way


def test_a_line_is_closed_for_its_time():
    road = SimpleNamespace(closed_first=[0, 1], closed=np.array([[20.0, 2.0, 5.0]]))
    assert traffic.closed_line(road, 0, 10.0, 2.0) == 20.0
    for front, now in ((21.0, 3.0), (10.0, 1.9), (10.0, 5.0)):
        assert traffic.closed_line(road, 0, front, now) == math.inf


def test_draws_are_uniform_and_normal_and_their_own():
    uniform, normal = for_python(traffic.uniform), for_python(traffic.normal)
    seed = np.uint64(7)
    flat = np.array([uniform(seed, 3, number) for number in range(4000)])
    assert flat.min() >= 0 and flat.max() < 1
    assert abs(flat.mean() - 0.5) < 4 * math.sqrt(1 / 12 / 4000)
    bell = np.array([normal(seed, 1, number) for number in range(4000)])
    assert abs(bell.mean()) < 4 / math.sqrt(4000) and abs(bell.std() - 1) < 0.05
    assert uniform(seed, 3, 5) == flat[5] != uniform(np.uint64(8), 3, 5)
