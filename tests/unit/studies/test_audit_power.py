"""A small version of the study; its full size is `socialiq reproduce audit-power`."""

import numpy as np
import pytest

from socialiq.studies.audit_power.population import Truth, draw_evidence
from socialiq.studies.audit_power.power import CASES, MARGIN, coverage_rows, verdict_rows


@pytest.fixture(scope="module")
def rates():
    return {row["case"]: row for row in verdict_rows(300, 20, 0, resamples=200)}


def test_evidence_has_the_true_values():
    truth = Truth(regret=0.4)
    found = draw_evidence(truth, 20_000, 0)
    weights = np.array([np.cos(np.pi / 4), np.sin(np.pi / 4)])
    means = np.array([one.mean for one in found.references])
    regret = (means @ weights).max() - np.array(found.policy.mean) @ weights
    assert regret == pytest.approx(0.4, abs=0.04)
    assert means == pytest.approx(truth.references, abs=0.06)
    assert found.policy.at_fault.mean() == pytest.approx(0.05, abs=0.006)
    assert found.policy.struck.mean() == pytest.approx(0.05, abs=0.006)
    assert (found.policy.ending == 3).mean() == pytest.approx(truth.timeout, abs=0.006)
    # 30 is between 5 and 60, the α̂ of the references for 30 and 60 degrees.
    assert truth.calibrated == pytest.approx(30 + 30 * 25 / 55)


def test_intervals_hold_the_truth_as_often_as_they_say():
    for row in coverage_rows(300, 100, 0, resamples=200):
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
    one, two, other = (coverage_rows(60, 4, seed, resamples=50) for seed in (0, 0, 900))
    assert one == two and MARGIN == 0.25
    first, second = (draw_evidence(Truth(), 5, seed).policy.totals for seed in (0, 900))
    assert (first != second).all()
    assert len(one) == len(other) == 12
