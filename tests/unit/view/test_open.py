"""Views by name: audits, policies and their decisions."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest

from socialiq.audit.request import Trust
from socialiq.errors import UserError
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.view import open as views
from socialiq.view.open import PolicyDecider, opened
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

MEANS = {"r_env": 1.0, "r_social": 1.0, "at_fault": 0.1, "struck": 0.2, "arrival": 0.7}


def row(actions, ending="arrival", **more):
    trace = None if actions is None else {"actions": actions}
    ended = {"r_env": 3.0, "r_social": -0.5, "ending": ending, "decisions": len(actions or "")}
    return {"episode": 4, "seed": str(2**63), "trace": trace} | ended | more


def report(worst, world="intersection", options=None):
    return {
        "declaration": {"angle": 30.0, "scenario": {"world": world, "options": options or {}}},
        "episodes": {"worst": worst, "median": [row("22")]},
        "policy": {"record": {"source": "idm"}, "means": {"name": "policy"} | MEANS},
        "references": [{"name": "go"} | MEANS],
        "verdict": {"decision": "fail", "reason": "A reason.", "episodes": 20},
    }


@pytest.fixture
def shown(monkeypatch, tmp_path):
    def show(*given, **more):
        monkeypatch.setattr(views, "read_report", lambda path: report(*given, **more))
        return opened(str(tmp_path), None, Trust())

    return show


def test_episodes_have_seed_decisions_and_totals_the_worst_first(shown):
    found = shown([row("0121", "collision, at fault"), row(None)])
    assert found.count == 2 and found.title == "Audit of idm"
    assert found.lead == "Fail, declared at 30°. A reason."
    one, two = found.part(0), found.part(1)
    assert one["seed"] == str(2**63) and one["actions"] == [0, 1, 2, 1]
    assert one["totals"] == [3.0, -0.5] and (one["ending"], two["ending"]) == (2, 1)
    assert one["mode"] == "worst 1, episode 4 of the audit" and two["mode"].startswith("median 1")
    json.dumps([one, found.data], allow_nan=False)


def test_drivers_are_the_policy_and_its_references(shown):
    policy, go = shown([row("0")]).data["modes"]
    assert (policy["mode"], go["mode"]) == ("policy", "go")
    assert policy["angle"] == pytest.approx(45.0) and policy["collision"] == pytest.approx(0.3)


def test_another_scenario_is_driven_as_it_was_and_not_beside_the_dials_curve(shown):
    plain = shown([row("0")])
    other = shown([row("0")], options={"spawn_probability": 0.5})
    assert plain.options == Options() and plain.data["curve"]
    assert other.options == Options(spawn_probability=0.5) and not other.data["curve"]


def test_what_can_not_be_replayed_is_refused_in_one_line(shown, monkeypatch):
    with pytest.raises(UserError, match="is an audit in crossing7"):
        shown([row("0")], world="crossing7")
    nothing = report([row(None)]) | {"episodes": {"worst": [row(None)], "median": []}}
    with pytest.raises(UserError, match="holds no decisions"):
        monkeypatch.setattr(views, "read_report", lambda path: nothing)
        opened(".", None, Trust())


def test_a_folder_that_is_no_audit_is_refused_in_one_line(tmp_path):
    with pytest.raises(UserError, match="name a folder that `socialiq audit` wrote"):
        opened(str(tmp_path), None, Trust())
    (tmp_path / "report.json").write_text("{")
    with pytest.raises(UserError, match="not JSON"):
        opened(str(tmp_path), None, Trust())


DIAL = str(packaged_results() / "intersection-dial" / "dial.safetensors")
TIMED = str(packaged_results() / "intersection-dial-clock" / "timed.safetensors")


@pytest.fixture(scope="module")
def seen():
    return Intersection().batch(8).reset(np.arange(100, 108))


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
