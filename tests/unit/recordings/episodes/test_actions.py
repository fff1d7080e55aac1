"""Inferred actions: 0.1615 of the difference to the target is left after a second at 10 Hz."""

import numpy as np
import pytest

from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import FASTER, IDLE, SLOWER
from socialiq_recordings.episodes.actions import inferred

LEFT = (1 - 0.1 / 0.6) ** 10


def test_the_simulators_own_speeds_leave_nothing_unexplained():
    speeds = [9.0]
    for target in (4.5, 0.0, 0.0, 4.5, 9.0):
        speeds.append(target + (speeds[-1] - target) * LEFT)
    found = inferred(np.array(speeds), Options())
    assert found.action.tolist() == [SLOWER, SLOWER, IDLE, FASTER, FASTER]
    assert found.residual == pytest.approx(np.zeros(5), abs=1e-9)


def test_idle_keeps_the_target_of_the_action_before():
    speeds = [4.5]
    for _ in range(3):
        speeds.append(9.0 + (speeds[-1] - 9.0) * LEFT)
    found = inferred(np.array(speeds), Options())
    assert found.action.tolist() == [FASTER, IDLE, IDLE]


def test_what_no_action_explains_is_reported():
    found = inferred(np.array([9.0, 13.0]), Options())
    assert found.action.tolist() == [IDLE]
    assert found.residual == pytest.approx([4.0])
    scaled = inferred(np.array([9.0, 13.0]), Options(target_speeds=(0.0, 7.0, 14.0)))
    assert scaled.action.tolist() == [FASTER]
    assert scaled.residual == pytest.approx([13.0 - (14.0 - 5.0 * LEFT)])


def test_a_decision_may_be_shorter():
    options = Options(policy_frequency=2)
    left = (1 - 0.1 / 0.6) ** 5
    found = inferred(np.array([9.0, 4.5 + 4.5 * left]), options)
    assert found.action.tolist() == [SLOWER] and found.residual == pytest.approx([0.0], abs=1e-9)
