"""A small version of the study; its full size is `socialiq reproduce audit-power`."""

import dataclasses

import numpy as np
import pytest

from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets, regret_test
from socialiq.audit.verdict.verdict import enough_resamples, join_tests
from socialiq_lab.registry import find
from studies.audit_power import grinding
from studies.audit_power.grinding import WAYS, Audit, draw_of, first_passes, grinding_rows
from studies.audit_power.power import (
    CASES,
    FLOOR,
    MARGIN,
    Truth,
    coverage_rows,
    draw_evidence,
    verdict_rows,
)

Config = find("audit-power").Config


@pytest.fixture(scope="module")
def rates():
    config = Config(episodes=300, replications=20, first_seed=0, resamples=200)
    return {row["case"]: row for row in verdict_rows(config)}


def test_evidence_has_the_true_values():
    truth = Truth(regret=0.4)
    found = draw_evidence(truth, 20_000, 0)
    weights = np.array([np.cos(np.pi / 4), np.sin(np.pi / 4)])
    means = np.array([one.mean for one in found.references])
    regret = (means @ weights).max() - np.array(found.policy.mean) @ weights
    assert regret == pytest.approx(0.4, abs=0.04)
    assert means == pytest.approx(truth.references, abs=0.06)
    assert found.policy.episodes.at_fault.mean() == pytest.approx(0.05, abs=0.006)
    assert found.policy.episodes.struck.mean() == pytest.approx(0.05, abs=0.006)
    assert (found.policy.episodes.ending == 3).mean() == pytest.approx(truth.timeout, abs=0.006)


def test_intervals_hold_the_truth_as_often_as_they_say():
    for row in coverage_rows(Config(episodes=300, replications=100, first_seed=0, resamples=200)):
        # The page states 2 percentage points; the count itself has a 99 % interval.
        assert row["high"] >= row["nominal"] - 0.02, row
        assert not row["exact"] or row["low"] <= row["nominal"] + 0.02, row
        assert row["covered"] >= 0.85, row  # an interval of half the width would hold 67 %


def test_known_policies_get_their_verdicts(rates):
    assert set(rates) == set(CASES)
    assert rates["regret well above"]["failed"] > 0.6
    assert rates["at fault twice as often"]["failed"] > 0.8
    for case in ("regret well above", "at fault twice as often"):
        assert rates[case]["passed"] == 0.0
    assert rates["well within"]["passed"] > 0.5
    assert rates["well within"]["failed"] == 0.0


def test_at_the_limit_errors_are_rare(rates):
    for case in (
        "regret at the margin",
        "at fault as often as allowed",
        "arrives as seldom as allowed",
        "regret and floor at their limits",
    ):
        assert rates[case]["passed_low"] <= 0.05 and rates[case]["failed_low"] <= 0.05
        assert rates[case]["inconclusive"] > 0.7


def test_it_is_seeded():
    short = Config(episodes=60, replications=4, resamples=50)
    one, two, other = (
        coverage_rows(dataclasses.replace(short, first_seed=seed)) for seed in (0, 0, 900)
    )
    assert one == two and MARGIN == 0.25
    first, second = (draw_evidence(Truth(), 5, seed).policy.totals for seed in (0, 900))
    assert (first != second).all()
    assert len(one) == len(other) == 11


EASY = Truth(regret=0.1, at_fault=0.03, struck=0.03, arrival=0.91)
"""Within the margin of 0.25, so that many tries pass."""


def test_each_way_spends_its_error():
    assert [WAYS["rerun, no log"].error(number) for number in (1, 2)] == [0.05, 0.05]
    assert [WAYS["rerun, log"].error(number) for number in (1, 2)] == [0.05 / 2, 0.05 / 6]
    at_home = WAYS["free byte, announced seed, log"]
    assert at_home.error(9) == 0.05 / 2  # the log sees the one audit that passes


def test_tries_differ_in_what_the_way_varies():
    for varied in ("rerun", "seed", "byte, announced seed", "byte, nonce"):
        one, two = (draw_of(varied, 5, number) for number in (1, 2))
        assert one == draw_of(varied, 5, 1) and one != draw_of(varied, 6, 1)
        assert one.derived("episodes") != two.derived("episodes")
        assert (one.commitment != two.commitment) == varied.startswith("byte")
        assert (one.seed == two.seed) == (varied == "byte, announced seed")


def test_a_way_passes_first_where_its_audits_do():
    found = first_passes(EASY, 100, 3, 100)
    assert any(found.values())
    for name, way in WAYS.items():
        tries = range(1, (found[name] or grinding.TRIES) + 1)
        by_hand = [
            Audit(EASY, draw_of(way.varied, 3, number), 100, 100).passes(way.error(number))
            for number in tries
        ]
        assert by_hand == [number == found[name] for number in tries]


@pytest.mark.parametrize("error", [0.05, 0.05 / 6])
def test_the_quick_rules_leave_out_no_pass(error):
    """A mean close to the margin, or no pass at a larger error: no pass at this one."""
    decided = []
    for number in range(1, 31):
        drawn = draw_of("rerun", 3, number)
        evidence = draw_evidence(EASY, 250, drawn.derived("episodes"))
        regrets = Regrets(evidence, drawn.derived("resampling"), enough_resamples(error, 400))
        test = regret_test(regrets, EASY.declared, MARGIN, error, error / 2)
        whole = join_tests(test, evidence.policy, FLOOR.bounds, error).decision is Decision.PASS
        decided.append((Audit(EASY, drawn, 250, 400).passes(error), whole))
    assert all(quick == whole for quick, whole in decided)
    assert 0 < sum(whole for _, whole in decided) < len(decided)


def test_shares_grow_with_the_tries_and_fall_with_a_log():
    rows = grinding_rows(Config(episodes=60, owners=6, first_seed=0, resamples=100))
    assert len(rows) == 2 * len(WAYS) * 5
    shares = {(row["policy"], row["way"], row["tries"]): row["passed"] for row in rows}
    for policy in grinding.POLICIES:
        for way in WAYS:
            by_tries = [shares[policy, way, tries] for tries in grinding.COUNTED]
            assert by_tries == sorted(by_tries)
        for varied in ("rerun", "owner's seeds", "free byte, announced seed"):
            for tries in grinding.COUNTED:
                logged = shares[policy, f"{varied}, log", tries]
                assert logged <= shares[policy, f"{varied}, no log", tries]
