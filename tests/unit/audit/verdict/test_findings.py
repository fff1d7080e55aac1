import dataclasses

import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.outcomes import episode_seeds
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.results import Finding, conclude
from socialiq.audit.verdict.verdict import judge
from socialiq.worlds.enumerate import TabularPolicy, expert_policy

FINDINGS = [Finding("margin", "It excludes nothing."), Finding("code", "Answers differ.")]


@pytest.fixture(name="passed", scope="module")
def an_expert_that_passes(declared, tabulated):
    table = tabulated("crossing7")
    policy = TabularPolicy(table.world, expert_policy(table, 45.0))
    profile = declared("crossing7", 45.0)
    found = judge(profile, collect_evidence(profile.world(), policy, episode_seeds(0, 200)), 1, 200)
    assert found.decision is Decision.PASS
    return found


def test_a_finding_forbids_a_pass(passed):
    found = conclude(passed, FINDINGS)
    assert found.decision is Decision.INCONCLUSIVE and found.needed is None
    assert found.reason == "It excludes nothing. Answers differ."
    assert found.regret is passed.regret and found.competence is passed.competence


def test_without_findings_the_tests_decide(passed):
    assert conclude(passed, []) is passed


def test_more_episodes_would_not_decide(passed):
    open_one = dataclasses.replace(passed, decision=Decision.INCONCLUSIVE, needed=700)
    found = conclude(open_one, FINDINGS)
    assert found.decision is Decision.INCONCLUSIVE and found.needed is None
    assert found.reason == "It excludes nothing. Answers differ."


def test_a_fail_stays_a_fail(passed):
    failed = dataclasses.replace(passed, decision=Decision.FAIL)
    assert conclude(failed, FINDINGS) is failed
