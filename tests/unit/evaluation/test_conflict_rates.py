"""Collisions against what was risked, by hand and of drivers by rule."""

import numpy as np
import pytest

from socialiq.evaluation.conflict_rates import rates
from socialiq.evaluation.play import episodes_of
from socialiq.statistics.tests import wilson
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy


@pytest.fixture(scope="module")
def waited():
    return episodes_of(Batch(Options(), 8), policy("wait"), range(8))


def test_rates_by_hand(waited):
    # Eight episodes, five of them enter: two strike there, one is struck there, and one more is
    # struck before it enters.
    found = rates(
        waited._replace(
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
    wide, narrow = rates(waited), rates(waited, 0.5)
    assert narrow["struck_per_episode_high"] < wide["struck_per_episode_high"]


def test_who_never_enters_has_no_rate_per_entry(waited):
    found = rates(waited)
    assert found["entries"] == found["pressed"] == 0 and found["conflicts"] > 0
    for kind in ("at_fault", "struck"):
        assert found[f"{kind}_per_episode"] == 0.0
        assert found[f"{kind}_per_entry"] is None is found[f"{kind}_per_entry_high"]
        assert found[f"{kind}_per_conflict"] == 0.0
        assert found[f"{kind}_per_pressed"] is None
