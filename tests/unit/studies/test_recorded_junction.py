"""Planted drivers of the study at a recorded junction, and its options."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_lab.registry import find
from studies.recorded_junction_practice.work import Rule, blocked, contents

Config = find("recorded-junction-practice").Config
LEVELS = (-4.0, -2.0, -1.0, 0.0, 1.0, 2.0)


def seen(speed: float, ahead: float, side: float, right: float = 0.0) -> np.ndarray:
    """The ego drives north; another is so far ahead and to the right, and drives to the right."""
    ego = [1.0, 0.0, 0.0, 0.0, -speed / 20, 0.0, -1.0]
    other = [1.0, side / 100, -ahead / 100, right / 20, 0.0, 1.0, 0.0]
    return np.array([ego + other + [0.0] * 7], np.float32)


@pytest.mark.parametrize(
    ("speed", "ahead", "side", "right", "short", "long"),
    [
        (8.0, 30.0, -20.0, 5.0, False, True),  # in the strip after 4 s, where the ego then is
        (8.0, 30.0, -20.0, -5.0, False, False),  # drives away
        (8.0, 10.0, 0.0, 0.0, True, True),  # stands in front
        (8.0, -10.0, 0.0, 0.0, False, False),  # behind
    ],
)
def test_a_rule_yields_to_whom_it_sees_coming(speed, ahead, side, right, short, long):
    there = seen(speed, ahead, side, right)
    assert blocked(there, 0.5)[0].tolist() == [short]
    assert blocked(there, 5.0)[0].tolist() == [long]
    assert blocked(there, 0.5)[1] == pytest.approx([speed])
    rule = Rule("looks", 5.0, 2.0, LEVELS)
    assert rule.predict(there)[0].tolist() == [1 if long else 5]


def test_who_stands_holds():
    standing = seen(0.0, 5.0, 0.0)
    assert Rule("looks", 1.0, 2.0, LEVELS).predict(standing)[0].tolist() == [3]


def test_options_that_make_no_study_are_refused(tmp_path):
    with pytest.raises(UserError, match="name the folder of the CommonRoad scenarios"):
        contents(Config(recordings=str(tmp_path)))
    with pytest.raises(UserError, match="two angles"):
        Config(angles=(0.0,))
    with pytest.raises(UserError, match="episodes"):
        Config(episodes=0)
