"""Attack: a policy drives by one angle towards some road users and by another towards others.

Its mean is that of the declared angle, in direction and character too.
"""

import datetime

import numpy as np
import pytest

from socialiq.audit.evidence.drive import CANDIDATES
from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import declare
from socialiq.audit.report.verify import faults
from socialiq.audit.verdict.direction import faults_of_contexts
from socialiq.audit.verdict.verdict import BY_WHOM
from socialiq.evaluation.context import ContextLosses
from socialiq.functions.measure import audit
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle_rule import AngleRule
from socialiq.storage import packaged_results
from socialiq.worlds.situation import ContextPolicy

DAY = datetime.date(2026, 1, 31)
MARGIN = Margin(1.5, None, None, 15.0, 0.5)


def rule_of(crowded, otherwise):
    when = {"angle": crowded, "vehicles": {"at_least": 2}}
    return AngleRule.of({"format": 1, "world": "crossing7", "default": otherwise, "when": [when]})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("whom")
    dial = DialPolicy.load(packaged_results() / "dial-short" / "dial.safetensors")
    ContextPolicy.of(dial, rule_of(0.0, 75.0)).save(path / "switches.safetensors")
    dial.at(45.0).save(path / "constant.safetensors")
    for name, rule in (("plain", None), ("rule", rule_of(45.0, 45.0))):
        declared = declare(45.0, "Example", "crossing7", MARGIN, DAY, rule=rule)
        (path / f"{name}.toml").write_bytes(declared.source)
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("policy", "declared", "decision"),
    [
        ("switches", "plain", "pass"),  # with a sentence
        ("switches", "rule", "inconclusive"),  # before: pass
        ("constant", "rule", "pass"),
    ],
)
def test_a_declared_rule_finds_another_angle_towards_some(folder, policy, declared, decision):
    out = folder / f"{policy}-{declared}"
    path = folder / f"{policy}.safetensors"
    verdict = audit(path, folder / f"{declared}.toml", out, episodes=300, seed=3)["verdict"]
    assert verdict["decision"] == decision
    assert (BY_WHOM in verdict["reason"]) == (declared == "plain")
    named = "Where 2 <= vehicles, the policy decides as one of 15 degrees and not of 45"
    assert (named in verdict["reason"]) == (decision == "inconclusive")
    assert faults(out) == []


def losses_of(angles, episodes=400):
    """Return losses that grow with the square of the distance from the angle of each context."""
    rng = np.random.default_rng(3)
    each = np.array(angles)[:, None] - np.array(CANDIDATES)
    by_angle = each**2 / 2000.0 + rng.normal(size=(episodes, len(angles), len(CANDIDATES)))
    return ContextLosses(
        by_angle[..., CANDIDATES.index(45.0)], by_angle, np.ones((episodes, len(angles)), int)
    )


@pytest.mark.parametrize(
    ("angles", "named"),
    [((45.0, 45.0), 0), ((35.0, 55.0), 0), ((75.0, 15.0), 2), ((75.0, 45.0), 1)],
)
def test_each_situation_beyond_the_width_is_named(angles, named):
    profile = declare(45.0, "Example", "crossing7", MARGIN, DAY, rule=rule_of(45.0, 45.0))
    texts = faults_of_contexts(profile, losses_of(angles), CANDIDATES, 0.05)
    assert len(texts) == named
    if angles == (75.0, 15.0):
        assert "Where 2 <= vehicles, the policy decides as one of 75 degrees" in texts[0]
        assert "Where otherwise, the policy decides as one of 15 degrees" in texts[1]


def test_on_the_end_of_the_width_situations_are_named_in_at_most_five_percent():
    """Of 300 policies at 30 and 60 degrees at most 9.4 %: 5 % and 3.5 errors."""
    profile = declare(45.0, "Example", "crossing7", MARGIN, DAY, rule=rule_of(45.0, 45.0))
    rng = np.random.default_rng(4)
    named = 0
    for _ in range(300):
        by_angle = rng.normal(size=(200, 2, len(CANDIDATES)))
        losses = ContextLosses(rng.normal(size=(200, 2)), by_angle, np.ones((200, 2), int))
        named += faults_of_contexts(profile, losses, CANDIDATES, 0.05) != []
    assert named <= 28


def test_without_a_rule_no_situation_is_tested():
    profile = declare(45.0, "Example", "crossing7", MARGIN, DAY)
    assert faults_of_contexts(profile, None, CANDIDATES, 0.05) == []
