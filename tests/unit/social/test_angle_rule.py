import tomllib

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.social.angle_rule import AngleRule, Interpolated, load_rule

RULE = """
format = 1
world = "intersection"
default = 20

[[when]]
angle = 75
waiting = {at_least = 1}
vehicles = {at_least = 2, at_most = 4}

[[when]]
angle = {by = "nearest_metres", at = [10, 30], degrees = [60, 20]}
crossing = {at_least = 1, at_most = 1}
"""

FEATURES = {
    "waiting": np.array([1.0, 1.0, 0.0, 0.0, 0.0]),
    "vehicles": np.array([2.0, 5.0, 3.0, 3.0, 3.0]),
    "crossing": np.array([1.0, 1.0, 1.0, 1.0, 0.0]),
    "nearest_metres": np.array([5.0, 20.0, 5.0, 99.0, 5.0]),
}


def read(text: str) -> AngleRule:
    return AngleRule.of(tomllib.loads(text))


def test_the_first_case_that_holds_gives_the_angle():
    rule = read(RULE)
    assert rule.context(FEATURES, 5).tolist() == [0, 1, 1, 1, 2]
    assert rule.degrees(FEATURES, 5).tolist() == [75.0, 40.0, 60.0, 20.0, 20.0]
    assert rule.span == (20.0, 75.0)
    assert rule.features == ("waiting", "vehicles", "crossing", "nearest_metres")
    assert rule.contexts[1:] == ("crossing = 1", "otherwise")


def test_a_rule_is_read_as_it_is_written():
    rule = read(RULE)
    assert AngleRule.of(rule.as_json()) == rule
    assert read(rule.as_toml()) == rule
    assert AngleRule.of(tomllib.loads(rule.as_toml("angle_rule"))["angle_rule"]) == rule


def test_a_constant_is_a_rule_without_cases():
    rule = AngleRule("crossing5", 30.0)
    assert rule.degrees({}, 3).tolist() == [30.0] * 3
    assert rule.contexts == ("always",)
    assert read(rule.as_toml()) == rule


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("default = 20", "", "needs a default"),
        ("default = 20", "default = nan", "got nan"),
        ("default = 20", "default = 360", r"in \[0, 360\)"),
        ("default = 20", "default = true", "number of degrees"),
        ("angle = 75", "", "case 1 .* needs an angle"),
        ("angle = 75", "angle = -1", "angle of case 1"),
        ("format = 1", "format = 2", "format = 1"),
        ("at_least = 2,", "at_least = 5,", "never holds"),
        ("at_least = 2,", "at_least = inf,", "number within"),
        ("at_least = 2,", "least = 2,", "at_least, at_most or both"),
        ("[10, 30]", "[30, 10]", "must rise"),
        ("[10, 30]", "[10]", "lists of 2 to 16"),
        ("[60, 20]", "[60, nan]", "got nan"),
        ("waiting =", '"Who waits" =', "not the name of a feature"),
        ("world =", "place =", "unknown field place"),
    ],
)
def test_a_bad_rule_is_refused_in_one_line(tmp_path, old, new, message):
    path = tmp_path / "rule.toml"
    path.write_text(RULE.replace(old, new))
    with pytest.raises(UserError, match=message) as caught:
        load_rule(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "rule.toml"
    for content in (b"\xff\xfe", b"a = [", b"x" * 20_000):
        path.write_bytes(content)
        with pytest.raises(UserError):
            load_rule(path)


def test_an_interpolated_angle_is_constant_beyond_its_points():
    rule = AngleRule("crossing7", Interpolated("vehicles", (0.0, 2.0), (0.0, 60.0)))
    values = np.array([-1.0, 0.5, 2.0, 7.0])
    assert rule.degrees({"vehicles": values}, 4).tolist() == [0.0, 15.0, 60.0, 60.0]
