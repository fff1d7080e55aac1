"""Vehicles at the junction and in conflict there: made-up views, and played ones."""

import numpy as np
import pytest

from socialiq.evaluation.episodes import (
    at_junction,
    conflict,
    conflict_at_junction,
    conflict_rates,
    entered,
    episodes_of,
)
from socialiq.evaluation.measures import Episodes
from socialiq.evaluation.simulate import play
from socialiq.statistics.intervals import wilson
from socialiq.worlds.intersection.options import SLOWER
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection

TURNING = (-1.0, 1.0)  # the ego's place when it has left its approach lane


def view(ego, *others):
    """An observation of one ego at (x, y) m and of others (x, y, vx, vy) in m and m/s."""
    seen = np.zeros((1, 10, 7))
    seen[0, 0, :3] = 1.0, *ego
    for place, other in enumerate(others, start=1):
        seen[0, place, :5] = 1.0, *other
    seen[..., 1:3] /= 100.0
    seen[..., 3:5] /= 20.0
    return seen.reshape(1, -1).astype(np.float32)


@pytest.mark.parametrize(
    ("ego", "there", "past"),
    [
        ((2.0, 40.0), False, False),
        ((2.0, 31.5), False, False),
        ((2.0, 30.5), True, False),
        ((2.0, 11.5), True, False),
        ((2.0, 10.5), True, True),
        (TURNING, True, True),
        ((-10.5, -2.0), True, True),
        ((-11.5, -2.0), False, True),  # gone to the west
        ((2.0, -11.5), False, True),  # gone to the north
        ((11.5, 2.0), False, True),  # gone to the east
    ],
)
def test_places_by_hand(ego, there, past):
    assert at_junction(view(ego))[0] == there
    assert entered(view(ego))[0] == past


@pytest.mark.parametrize("ego", [(2.0, 20.0), TURNING])
@pytest.mark.parametrize(
    ("other", "expected"),
    [
        ((0.0, 0.0, 0.0, 0.0), True),  # stands in the junction
        ((-28.5, 2.0, 8.0, 0.0), True),  # 19.5 m before it at 8 m/s: 2.4 s
        ((-34.5, 2.0, 8.0, 0.0), False),  # 3.2 s
        ((-20.0, -2.0, -8.0, 0.0), False),  # leaves
        ((-20.0, 2.0, 0.0, 0.0), False),  # waits
        ((2.0, 25.0, 0.0, -8.0), False),  # follows the ego
        ((-2.0, -25.0, 0.0, 8.0), True),  # comes the other way
    ],
)
def test_conflicts_by_hand(ego, other, expected):
    assert conflict(view(ego, other), 3.0)[0] == expected
    assert conflict_at_junction(view(ego, other))[0] == expected


def test_far_from_the_junction_nothing_is_met():
    other = (0.0, 0.0, 0.0, 0.0)
    assert conflict(view((2.0, 40.0), other), 3.0)[0]
    assert not conflict_at_junction(view((2.0, 40.0), other))[0]


def test_nobody_is_in_conflict_with_no_one():
    assert not conflict(view(TURNING), 3.0)[0]
    assert conflict_at_junction(np.zeros((0, 70), np.float32)).shape == (0,)


def test_the_driver_who_accepts_gaps_of_3_s_brakes_for_the_same_conflicts():
    judged = 0
    for step in play(Intersection().batch(64), policy("gap_3s"), range(200)):
        seen, action = step.observation[step.running], step.action[step.running]
        judging = at_junction(seen) & ~entered(seen)
        met = conflict_at_junction(seen)
        np.testing.assert_array_equal(action[judging] == SLOWER, met[judging])
        judged += met[judging].sum()
    assert judged > 500


@pytest.fixture(scope="module")
def waited():
    return episodes_of(Intersection().batch(8), policy("wait"), range(8))


def test_rates_by_hand():
    # Eight episodes, five of them enter: two strike there, one is struck there, and one more is
    # struck before it enters.
    found = conflict_rates(
        Episodes(
            ending=np.array([2, 2, 2, 1, 1, 2, 3, 3]),
            contact=np.array([1, 1, 2, 0, 0, 2, 0, 0]),
            entered=np.array([True] * 5 + [False] * 3),
            conflicts=np.array([4, 3, 2, 1, 0, 5, 3, 2]),
            pressed=np.array([3, 1, 0, 1, 0, 0, 0, 0]),
        )
    )
    assert (found["episodes"], found["entries"]) == (8, 5)
    assert (found["conflicts"], found["pressed"]) == (20, 5)
    assert (found["at_fault"], found["struck"]) == (2, 2)
    for kind, inside in (("at_fault", 2), ("struck", 1)):
        for name, expected in (("episode", wilson(2, 8)), ("entry", wilson(inside, 5))):
            key = f"{kind}_per_{name}"
            assert (found[key], found[f"{key}_low"], found[f"{key}_high"]) == expected
        assert found[f"{kind}_per_conflict"] == pytest.approx(2 / 20)
        assert found[f"{kind}_per_pressed"] == pytest.approx(2 / 5)


def test_less_confidence_gives_a_narrower_interval(waited):
    wide, narrow = conflict_rates(waited), conflict_rates(waited, 0.5)
    assert narrow["struck_per_episode_high"] < wide["struck_per_episode_high"]


def test_who_never_enters_has_no_rate_per_entry(waited):
    found = conflict_rates(waited)
    assert found["entries"] == found["pressed"] == 0 and found["conflicts"] > 0
    for kind in ("at_fault", "struck"):
        assert found[f"{kind}_per_episode"] == 0.0
        assert found[f"{kind}_per_entry"] is None is found[f"{kind}_per_entry_high"]
        assert found[f"{kind}_per_conflict"] == 0.0
        assert found[f"{kind}_per_pressed"] is None
