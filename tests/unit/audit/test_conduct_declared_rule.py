"""Audits of a declared rule of the angle: of a driver who follows it, and of a constant angle."""

import datetime
from pathlib import Path

import numpy as np
import pytest

from socialiq.audit.evidence.table import CONTEXTS, read_contexts, write_contexts
from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.reader import parse
from socialiq.audit.profile.template import declare
from socialiq.audit.report.folder import sealed
from socialiq.audit.report.verify import faults, read_report
from socialiq.audit.report.views import colour
from socialiq.cli.output import Result
from socialiq.errors import UserError
from socialiq.evaluation.context import ContextLosses
from socialiq.functions.measure import audit
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle_rule import AngleRule
from socialiq.storage import packaged_results
from socialiq.worlds.situation import ContextPolicy

WHEN = {"angle": 75, "approaching": {"at_least": 1}}
RULE = AngleRule.of({"format": 1, "world": "crossing7", "default": 0, "when": [WHEN]})
DATE = datetime.date(2026, 1, 31)


@pytest.fixture(name="profile", scope="module")
def declared_rule(tmp_path_factory):
    path = tmp_path_factory.mktemp("rule") / "profile.toml"
    made = declare(45.0, "Example", "crossing7", Margin(0.1, 10.0), DATE, rule=RULE)
    assert made.rule == RULE and parse(made.source) == made
    path.write_bytes(made.source)
    dial = DialPolicy.load(packaged_results() / "dial-short" / "dial.safetensors")
    ContextPolicy.of(dial, RULE).save(path.parent / "follows.safetensors")
    dial.at(45.0).save(path.parent / "constant.safetensors")
    return path


def audited(profile: Path, name: str, out: Path) -> Result:
    policy = profile.parent / f"{name}.safetensors"
    return audit(policy, profile, out, episodes=300, seed=3)


@pytest.mark.slow
def test_the_driver_that_follows_the_rule_passes(profile, tmp_path):
    report = audited(profile, "follows", tmp_path / "out")
    assert report["verdict"]["decision"] == "pass"
    assert "by the declared rule" in report["verdict"]["reason"]
    assert report["tests"]["regret"]["regret"] == pytest.approx(0.0, abs=1e-9)
    assert report["tests"]["regret"]["best"] == "as_declared"
    assert faults(tmp_path / "out") == []
    text = (tmp_path / "out" / "report.md").read_text()
    assert "The angle that it follows, by context" in text
    assert "decision loss at the declared rule" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.slow
def test_a_constant_angle_that_declares_the_rule_fails(profile, tmp_path):
    report = audited(profile, "constant", tmp_path / "out")
    assert report["verdict"]["decision"] == "fail"
    assert report["tests"]["regret"]["low"] > 0.2
    approaching, otherwise = report["tests"]["contexts"]
    assert approaching["low"] > 0.2 and otherwise["loss"] == pytest.approx(0.0, abs=1e-9)
    kept = [one["angle"] for one in approaching["by_angle"] if one["compatible"]]
    assert 45.0 in kept and 75.0 not in kept
    losses = tmp_path / "out" / CONTEXTS
    changed = losses.read_text().replace("\n0,0,", "\n0,0,1", 1)
    files = {
        one.relative_to(tmp_path / "out").as_posix(): one.read_bytes()
        for one in (tmp_path / "out").rglob("*")
        if one.is_file()
    }
    report = read_report(tmp_path / "out" / "report.json")
    kept_files = {name: one for name, one in files.items() if "MANIFEST" not in name}
    for name, one in sealed({**kept_files, CONTEXTS: changed.encode()}, report).items():
        (tmp_path / "out" / name).write_bytes(one)
    assert any("contexts" in one for one in faults(tmp_path / "out"))


def rule_of(angle: float, approaching: float) -> AngleRule:
    """Return the rule of 45 degrees with another angle from a number of approaching vehicles on."""
    when = {"angle": angle, "approaching": {"at_least": approaching}}
    return AngleRule.of({"format": 1, "world": "crossing7", "default": 45, "when": [when]})


def declared_by(rule: AngleRule, place: Path, margin: Margin) -> Path:
    """Write a declaration of a rule beside policies of 15 and of 90 degrees."""
    dial = DialPolicy.load(packaged_results() / "dial-short" / "dial.safetensors")
    dial.at(90.0).save(place / "altruist.safetensors")
    dial.at(15.0).save(place / "fifteen.safetensors")
    profile = declare(45.0, "Example", "crossing7", margin, DATE, rule=rule)
    (place / "profile.toml").write_bytes(profile.source)
    return place / "profile.toml"


@pytest.mark.slow
def test_a_condition_that_never_holds_shows_no_angle(tmp_path):
    """Before, the driver of 15 degrees "behaves as declared" at 45 without a caveat."""
    path = declared_by(rule_of(0.0, 1000.0), tmp_path, Margin(0.1))
    report = audited(path, "fifteen", tmp_path / "out")
    assert report["verdict"]["decision"] == "pass"
    assert "Direction and character are not tested" in report["verdict"]["reason"]
    assert colour(report) == "kept"
    texts = [row["text"] for row in report["caveats"] if row["about"] == "rule"]
    assert "not tested where 1000 <= approaching" in texts[1]


@pytest.mark.slow
def test_a_rule_within_one_width_is_tested_as_that_angle(tmp_path):
    path = declared_by(rule_of(50.0, 1.0), tmp_path, Margin(1.5, None, None, 15.0, 0.075))
    report = audited(path, "altruist", tmp_path / "out")
    assert report["verdict"]["decision"] == "fail"
    assert report["tests"]["direction"]["decision"] == "fail"
    assert "beyond the declared width" in report["verdict"]["reason"]
    assert faults(tmp_path / "out") == []


def test_a_width_holds_all_angles_of_a_rule_or_is_refused(tmp_path):
    with pytest.raises(UserError, match="no further apart than the width"):
        declared_by(rule_of(0.0, 1000.0), tmp_path, Margin(0.5, None, None, 15.0))


def test_what_is_not_tested_with_a_rule_is_refused(profile, tmp_path):
    dial = packaged_results() / "dial-short" / "dial.safetensors"
    with pytest.raises(UserError, match="turn --angle-rule"):
        audit(dial, profile, tmp_path / "out", episodes=30, seed=3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("approaching =", "speeding =", "unknown feature of crossing7"),
        ("default = 0.0\n", "", "needs a default"),
        ("angle = 75.0", "angle = nan", "got nan"),
        ('world = "crossing7"\ndefault', 'world = "crossing5"\ndefault', "not for crossing7"),
    ],
)
def test_a_bad_rule_is_refused_with_the_line_of_its_table(profile, old, new, message):
    text = profile.read_text()
    assert old in text
    line = text[: text.index("[angle_rule]")].count("\n") + 1
    with pytest.raises(UserError, match=message) as caught:
        parse(text.replace(old, new).encode())
    assert str(caught.value).startswith(f"profile.toml:{line}:")


def test_contexts_are_read_as_they_are_written():
    random = np.random.default_rng(0)
    losses = ContextLosses(
        random.normal(size=(3, 2)), random.normal(size=(3, 2, 2)), np.arange(6).reshape(3, 2)
    )
    text = write_contexts(losses, (0.0, 45.0)).encode()
    for one, other in zip(read_contexts(text, 3, 2, (0.0, 45.0)), losses, strict=True):
        np.testing.assert_array_equal(one, other)
    for damaged in (b"", text[:-4], text.replace(b"at_45", b"at_50"), text.replace(b",", b";")):
        with pytest.raises(UserError):
            read_contexts(damaged, 3, 2, (0.0, 45.0))
