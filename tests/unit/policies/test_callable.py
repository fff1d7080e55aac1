import hashlib

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.policies.load import load_policy

CODE = """
import pathlib
import numpy as np
pathlib.Path(__file__).with_suffix(".ran").touch()

def positive(observations):
    return (observations[:, 0] > 0).astype(int)

class Policy:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(len(observation), 2 if deterministic else 1), state

instance = Policy()
number = 3

def leaves(observations):
    raise SystemExit("leaves")

def speaks(observations):
    raise ValueError("two\\nlines \\x1b[31m")

def scores(observations):
    return observations
"""
OBSERVATIONS = np.array([[1.0, 0.0], [-1.0, 0.0]])


@pytest.fixture
def spec(tmp_path):
    (tmp_path / "theirs.py").write_text(CODE)
    return lambda name: f"python:{tmp_path / 'theirs.py'}:{name}"


def opened(spec):
    return load_policy(spec, 2, 3, allow_code=True)


def test_code_runs_only_if_that_is_allowed(spec, tmp_path):
    with pytest.raises(UserError, match="would run its author's code"):
        load_policy(spec("positive"), 2, 3)
    assert not (tmp_path / "theirs.ran").exists()
    opened(spec("positive"))
    assert (tmp_path / "theirs.ran").exists()


def test_function_class_and_instance_are_policies(spec):
    assert opened(spec("positive")).policy.predict(OBSERVATIONS)[0].tolist() == [1, 0]
    for name in ("Policy", "instance"):
        policy = opened(spec(name)).policy
        assert policy.predict(OBSERVATIONS)[0].tolist() == [2, 2]
        assert policy.predict(OBSERVATIONS, deterministic=False)[0].tolist() == [1, 1]


def test_module_may_be_named(tmp_path, monkeypatch):
    (tmp_path / "a_policy_of_theirs.py").write_text(CODE)
    monkeypatch.syspath_prepend(tmp_path)
    loaded = opened("python:a_policy_of_theirs:positive")
    assert loaded.record.sha256 == hashlib.sha256(CODE.encode()).hexdigest()
    assert loaded.record.kind == "python"


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("missing", "raised AttributeError"),
        ("number", "is not a policy"),
        ("a b", "is not MODULE:ATTRIBUTE"),
        ("", "is not MODULE:ATTRIBUTE"),
    ],
)
def test_attribute_must_be_a_policy(spec, name, match):
    with pytest.raises(UserError, match=match):
        opened(spec(name))


@pytest.mark.parametrize("place", ["no_such_module_here", "no/such/file.py", ""])
def test_module_must_be_there(place):
    with pytest.raises(UserError, match=r"ModuleNotFoundError|no such|is no"):
        opened(f"python:{place}:policy")


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("leaves", "raised SystemExit: leaves"),
        ("speaks", "raised ValueError: two lines"),
        ("scores", "it must be one integer"),
    ],
)
def test_what_its_code_does_wrong_is_told_in_one_line(spec, name, match):
    policy = opened(spec(name)).policy
    with pytest.raises(UserError, match=match) as caught:
        policy.predict(OBSERVATIONS)
    assert "\n" not in str(caught.value) and "\x1b" not in str(caught.value)


def test_module_that_leaves_is_told(tmp_path):
    (tmp_path / "leaving.py").write_text("raise SystemExit(0)")
    with pytest.raises(UserError, match="raised SystemExit"):
        opened(f"python:{tmp_path / 'leaving.py'}:policy")
