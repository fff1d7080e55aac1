"""Python policies in a process of their own answer as those in this process."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.isolation import NOT_ASKED
from socialiq.policies.load import load_policy

CODE = """
import dataclasses
import numpy as np

print("a line that is no answer")


@dataclasses.dataclass
class Policy:
    bias: float = 0.1

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        assert observation.dtype == np.float32 and observation.ndim == 2
        scores = observation @ np.float32([[1, 2, 3], [3, 1, 2]]) + np.float32(self.bias)
        return scores.argmax(axis=1) if deterministic else np.zeros(len(observation), int), state


instance = Policy()


def positive(observations):
    print("another")
    return [int(one > 0) for one in observations[:, 0]]


def leaves(observations):
    raise SystemExit("leaves")


def speaks(observations):
    raise ValueError("two\\nlines \\x1b[31m " + "long" * 1000)


def scores(observations):
    return observations


def ragged(observations):
    return [[0], [0, 1]]


def boolean(observations):
    return observations[:, 0] > 0


def ends(observations):
    import os
    os._exit(3)


number = 3
"""
OBSERVATIONS = np.random.default_rng(2).normal(size=(40, 2)).astype(np.float32)


@pytest.fixture
def opened(tmp_path):
    (tmp_path / "theirs.py").write_text(CODE)
    started = []

    def made(name, **more):
        more = {"allow_code": True, "isolation": NOT_ASKED} | more
        started.append(load_policy(f"python:{tmp_path / 'theirs.py'}:{name}", 2, 3, **more))
        return started[-1]

    yield made
    for one in started:
        one.close()


@pytest.mark.parametrize("name", ["Policy", "instance", "positive"])
def test_answers_are_those_of_the_same_code_here(opened, name):
    there, here = opened(name), opened(name, isolation=None)
    for deterministic in (True, False):
        for batch in (OBSERVATIONS, OBSERVATIONS[:1], OBSERVATIONS[0]):
            found, _ = there.policy.predict(batch, deterministic=deterministic)
            expected, _ = here.policy.predict(batch, deterministic=deterministic)
            np.testing.assert_array_equal(found, expected)
    assert there.record.kind == here.record.kind == "python"
    assert there.record.isolation == ("none", "it was not asked for")


def test_without_isolation_it_needs_permission(opened):
    with pytest.raises(UserError, match="would run its author's code with your rights"):
        opened("positive", allow_code=False)


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("leaves", "raised SystemExit: leaves; correct its code"),
        ("speaks", r"raised ValueError: two lines \[31m long"),
        ("scores", r"answered float32 of shape \(40, 2\): it must be one integer for each of 40"),
        ("ragged", "must answer one action for each observation"),
        ("boolean", "answered bool"),
        ("ends", "ended before it answered"),
    ],
)
def test_a_mistake_of_its_code_is_told_in_one_line(opened, name, match):
    policy = opened(name).policy
    with pytest.raises(UserError, match=match) as caught:
        policy.predict(OBSERVATIONS)
    assert "\n" not in str(caught.value) and "\x1b" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "match"),
    [("missing", "raised AttributeError"), ("number", "is not a policy: it must be a function")],
)
def test_the_attribute_must_be_a_policy(opened, name, match):
    with pytest.raises(UserError, match=match):
        opened(name)


def test_a_module_is_found_as_here_with_its_neighbours(tmp_path, monkeypatch):
    folder = tmp_path / "package_of_theirs"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "driver.py").write_text(
        "from package_of_theirs import helper\n\n\n"
        "def policy(batch):\n    return helper.act(batch)\n"
    )
    (folder / "helper.py").write_text("def act(batch):\n    return [2 for _ in batch]\n")
    monkeypatch.syspath_prepend(tmp_path)
    name = "python:package_of_theirs.driver:policy"
    with load_policy(name, 2, 3, allow_code=True, isolation=NOT_ASKED) as loaded:
        assert loaded.policy.predict(OBSERVATIONS[:2])[0].tolist() == [2, 2]
        loaded.check_unchanged()
        (folder / "helper.py").write_text("def act(batch):\n    return [1 for _ in batch]\n")
        with pytest.raises(UserError, match="changed while it was audited"):
            loaded.check_unchanged()
