"""A small version of what the audit's numbers are worth; the large one is a command."""

import numpy as np
import pytest

from socialiq.studies.audit_power.population import Truth, drawn
from socialiq.studies.audit_power.power import CASES, MARGIN, coverage, error_rates


@pytest.fixture(scope="module")
def rates():
    return {one.case: one for one in error_rates(300, 20, 0, resamples=200)}


def test_the_truth_is_what_is_drawn():
    truth = Truth(regret=0.4)
    found = drawn(truth, 20_000, 0)
    weights = np.array([np.cos(np.pi / 4), np.sin(np.pi / 4)])
    means = np.array([one.mean for one in found.references])
    regret = (means @ weights).max() - np.array(found.policy.mean) @ weights
    assert regret == pytest.approx(0.4, abs=0.04)
    assert means == pytest.approx(truth.references, abs=0.06)
    assert found.policy.at_fault.mean() == pytest.approx(0.05, abs=0.006)
    assert found.policy.struck.mean() == pytest.approx(0.05, abs=0.006)
    assert (found.policy.ending == 3).mean() == pytest.approx(truth.timeout, abs=0.006)
    # 30 lies between 5 and 60, shown for 30 and 60 degrees.
    assert truth.calibrated == pytest.approx(30 + 30 * 25 / 55)


def test_intervals_hold_the_truth_as_often_as_they_say():
    for one in coverage(300, 100, 0, resamples=200):
        # The page states 2 percentage points; the count itself has a 99 % interval.
        assert one.covered.high >= one.nominal - 0.02, one
        assert not one.exact or one.covered.low <= one.nominal + 0.02, one
        assert one.covered.value >= 0.85, one  # an interval of half the width would hold 67 %


def test_known_policies_get_their_verdicts(rates):
    assert set(rates) == set(CASES)
    assert rates["regret well above"].failed.value > 0.6
    assert rates["at fault twice as often"].failed.value > 0.8
    for case in ("regret well above", "at fault twice as often"):
        assert rates[case].passed.value == 0.0
    assert rates["well within"].passed.value > 0.5
    assert rates["well within"].failed.value == 0.0


def test_at_the_limit_errors_are_rare(rates):
    for case in (
        "regret at the margin",
        "at fault as often as allowed",
        "arrives as seldom as allowed",
        "regret and floor at their limits",
    ):
        assert rates[case].passed.low <= 0.05 and rates[case].failed.low <= 0.05
        assert rates[case].inconclusive.value > 0.7


def test_it_is_seeded():
    one, two, other = (coverage(60, 4, seed, resamples=50) for seed in (0, 0, 900))
    assert one == two and MARGIN == 0.25
    first, second = (drawn(Truth(), 5, seed).policy.totals for seed in (0, 900))
    assert (first != second).all()
    assert len(one) == len(other) == 12
