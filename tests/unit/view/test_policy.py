"""Decisions of a policy for the page."""

import contextlib
from pathlib import Path

import numpy as np
import pytest

from socialiq.audit.request import Trust
from socialiq.errors import UserError
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.view.open import opened
from socialiq.view.policy import PolicyDecider
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Batch

DIAL = str(packaged_results() / "intersection-dial" / "dial.safetensors")
TIMED = str(packaged_results() / "intersection-dial-clock" / "timed.safetensors")


@pytest.fixture(scope="module")
def seen():
    return Batch(Options(), 8).reset(np.arange(100, 108))


def question(seen, **more):
    return {"observations": seen.tolist(), "decisions": [0] * len(seen)} | more


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0])
def test_a_dial_answers_at_the_angle_that_is_asked(seen, angle):
    with contextlib.closing(PolicyDecider(DIAL, 45.0, Trust())) as decider:
        found = decider.decide(question(seen, angle=angle))["actions"]
    assert found == DialPolicy.load(Path(DIAL)).at(angle).predict(seen)[0].tolist()


def test_a_dial_with_a_clock_gets_the_time(seen):
    late = question(seen, angle=60) | {"decisions": [9] * len(seen)}
    with contextlib.closing(PolicyDecider(TIMED, 60.0, Trust())) as decider:
        found = decider.decide(late)["actions"]
    timed = np.column_stack([seen, np.full(len(seen), 9, np.float32)])
    assert found == DialPolicy.load(Path(TIMED)).at(60.0).predict(timed)[0].tolist()


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"observations": [], "decisions": []},
        {"observations": [[0.0] * 69], "decisions": [0]},
        {"observations": [[0.0] * 70], "decisions": []},
        {"observations": [[float("nan")] * 70], "decisions": [0]},
        {"observations": [["a"] * 70], "decisions": [0]},
        {"observations": [[0.0] * 70] * 65, "decisions": [0] * 65},
        {"observations": {"a": 1}, "decisions": [0]},
    ],
)
def test_a_question_that_the_page_never_asks_is_refused_in_one_line(wrong):
    with (
        contextlib.closing(PolicyDecider("idm", 0.0, Trust())) as decider,
        pytest.raises(UserError, match="not known: reload it"),
    ):
        decider.decide(wrong)


def test_an_angle_that_the_dial_lacks_is_refused(seen):
    with contextlib.closing(PolicyDecider(DIAL, 45.0, Trust())) as decider:
        for angle in (180, "a", -1, [1]):
            with pytest.raises(UserError):
                decider.decide(question(seen, angle=angle))


def test_what_is_named_is_opened_or_refused_in_one_line(tmp_path):
    found = opened(DIAL, 30.0, Trust())
    assert found.kind == "policy" and found.data["dial"]["angle"] == 30.0
    found.close()
    with pytest.raises(UserError, match="--angle is of a dial, which idm is not"):
        opened("idm", 30.0, Trust())
    with pytest.raises(UserError, match="no policy 'nowhere'"):
        opened("nowhere", None, Trust())
    with pytest.raises(UserError, match=r"no such file: nowhere\.onnx"):
        opened("nowhere.onnx", None, Trust())
    (tmp_path / "broken.onnx").write_bytes(b"broken")
    with pytest.raises(UserError):
        opened(str(tmp_path / "broken.onnx"), None, Trust())
