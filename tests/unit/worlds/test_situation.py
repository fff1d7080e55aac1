import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.social.angle_rule import AngleRule
from socialiq.worlds.situation import SITUATIONS, TIME, angles_of, check_rule, features_of

ROW = 7


def rule_of(world: str, *names: str) -> AngleRule:
    cases = [{"angle": 60, name: {"at_least": 1}} for name in names]
    return AngleRule.of({"format": 1, "world": world, "default": 0, "when": cases})


def test_features_of_crossing7():
    names = tuple(SITUATIONS["crossing7"])
    # ego cell and speed; then place and speed of both vehicles, -1 for none
    states = np.array([[2, 1, 1, 0, -1, 0], [0, 0, 4, 2, 2, 2], [6, 2, -1, 0, -1, 0]])
    found = {name: one.tolist() for name, one in _each("crossing7", names, states).items()}
    assert found == {
        "approaching": [1, 1, 0],
        "waiting": [1, 0, 0],
        "vehicles": [1, 2, 0],
        "nearest_cells": [2, 1, 7],
        "cells_to_conflict": [1, 3, -3],
        "ego_speed": [1, 0, 2],
    }


def test_features_of_crossing5():
    states = np.array([[0, 2, 2, 1], [3, 2, 2, 2]])
    found = _each("crossing5", tuple(SITUATIONS["crossing5"]), states)
    assert found["approaching"].tolist() == [1, 0]
    assert found["cells_to_conflict"].tolist() == [2, -1]


def test_features_of_the_intersection():
    seen = np.zeros((1, 4 * ROW), np.float32)
    rows = seen.reshape(4, ROW)
    rows[0] = (1, 0.02, 0.41, 0, -0.4, 0, -1)  # the ego: 41 m south of the centre, 8 m/s north
    rows[1] = (1, -0.15, 0.02, 0.5, 0, 1, 0)  # 10 m/s to the east, 6 m before the junction
    rows[2] = (1, 0.06, 0.40, 0, 0, 0, -1)  # stands 4 m beside the ego
    names = tuple(SITUATIONS["intersection"])
    found = _each("intersection", names[:5], seen) | _each("intersection", names[5:], seen)
    expected = {"vehicles": 2, "vehicles_within_30m": 1, "waiting": 1, "crossing": 1}
    expected |= {"crossing_with_priority": 1, "metres_to_stop_line": 30.0, "ego_speed": 8.0}
    for name, value in expected.items():
        assert found[name] == pytest.approx([value], abs=1e-4), name
    assert found["nearest_metres"] == pytest.approx([np.hypot(4, 1)], abs=1e-4)
    assert found["nearest_on_the_left"].tolist() == [0]
    rows[2, 1] = -0.02
    assert _each("intersection", names[5:], seen)["nearest_on_the_left"].tolist() == [1]


def _each(world: str, names: tuple[str, ...], seen: np.ndarray) -> dict[str, np.ndarray]:
    return features_of(rule_of(world, *names), seen)


def test_the_time_is_a_feature_where_policies_have_a_clock():
    rule = rule_of("intersection", TIME)
    angles, context = angles_of(rule, np.zeros((2, 2 * ROW)), np.array([0.0, 1.0]))
    assert angles.tolist() == [0.0, 60.0] and context.tolist() == [1, 0]
    with pytest.raises(UserError, match="no clock"):
        check_rule(rule, clock=False)
    with pytest.raises(UserError, match="unknown feature of crossing7"):
        check_rule(rule_of("crossing7", TIME))


def test_a_rule_is_for_the_features_of_its_world():
    check_rule(rule_of("crossing7", "waiting"), "crossing7")
    with pytest.raises(UserError, match="choose one of approaching"):
        check_rule(rule_of("crossing5", "waiting"))
    with pytest.raises(UserError, match="not for crossing5"):
        check_rule(rule_of("crossing7", "waiting"), "crossing5")
    with pytest.raises(UserError, match="unknown world of a rule"):
        check_rule(rule_of("highway", "waiting"))
