"""The tests of the safety floor and of effects by hand, and the joint decision."""

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from socialiq.audit.profile.profile import Bound, Floor
from socialiq.audit.verdict.bounds import MOST_CUT, bound_tests, faults_of_limits
from socialiq.audit.verdict.decision import Decision, joint_decision
from socialiq.statistics.intervals import clopper_pearson, wilson
from socialiq.types import Ending

FLOOR = Floor(max_at_fault=0.1, max_struck=0.1, min_arrival=0.8, max_timeout=0.1)


def test_one_that_fails_fails_all():
    passes, fails, undecided = Decision.PASS, Decision.FAIL, Decision.INCONCLUSIVE
    assert joint_decision([passes, passes]) is passes
    assert joint_decision([passes, undecided]) is undecided
    assert joint_decision([passes, undecided, fails]) is fails


def driver(outcomes, at_fault=0, struck=0, timeout=0, episodes=200):
    collided = [Ending.COLLISION] * (at_fault + struck) + [Ending.TIMEOUT] * timeout
    kinds = collided + [Ending.ARRIVAL] * (episodes - len(collided))
    contact = [1] * at_fault + [2] * struck + [0] * (episodes - at_fault - struck)
    return outcomes("driver", [[0.0, 0.0]] * episodes, kinds, contact)


def by_name(outcomes, floor=FLOOR, **events):
    return {one.name: one for one in bound_tests(driver(outcomes, **events), floor.bounds)}


def test_bounds_are_exact_at_their_levels(outcomes):
    found = by_name(outcomes, at_fault=10)
    # Passing at 5 % one-sided, failing at 5 % / 4.
    upper = binomtest(10, 200).proportion_ci(0.9, "exact").high
    lower = binomtest(10, 200).proportion_ci(0.975, "exact").low
    assert (found["at_fault"].low, found["at_fault"].high) == pytest.approx((lower, upper))
    arrived = binomtest(190, 200)
    assert found["arrival"].low == pytest.approx(arrived.proportion_ci(0.9, "exact").low)
    assert found["arrival"].high == pytest.approx(arrived.proportion_ci(0.975, "exact").high)
    assert found["arrival"].share == 0.95 and found["arrival"].count == 190


@pytest.mark.parametrize(
    ("events", "name", "decision"),
    [
        ({}, "at_fault", Decision.PASS),
        ({"at_fault": 10}, "at_fault", Decision.PASS),
        ({"at_fault": 20}, "at_fault", Decision.INCONCLUSIVE),
        ({"at_fault": 40}, "at_fault", Decision.FAIL),
        ({"at_fault": 40}, "struck", Decision.PASS),
        ({"struck": 40}, "struck", Decision.FAIL),
        ({"struck": 40}, "at_fault", Decision.PASS),
        ({"timeout": 40}, "timeout", Decision.FAIL),
        ({"timeout": 40}, "arrival", Decision.INCONCLUSIVE),
        ({"timeout": 80}, "arrival", Decision.FAIL),
        ({"timeout": 10}, "arrival", Decision.PASS),
    ],
)
def test_each_criterion_by_itself(outcomes, events, name, decision):
    assert by_name(outcomes, **events)[name].decision is decision


def test_nothing_seen_is_not_nothing(outcomes):
    floor = Floor(max_at_fault=0.0, max_struck=1.0, min_arrival=0.0, max_timeout=1.0)
    found = by_name(outcomes, floor)
    assert found["at_fault"].decision is Decision.INCONCLUSIVE  # never is beyond any sample
    assert found["at_fault"].needed is None
    assert {found[name].decision for name in ("struck", "arrival", "timeout")} == {Decision.PASS}


def test_episodes_needed(outcomes):
    # 0.05 against 0.1 with σ² = 0.09: (2.926 * 0.3 / 0.05)² = 309
    assert by_name(outcomes, at_fault=10)["at_fault"].needed == pytest.approx(309, abs=1)


@pytest.mark.parametrize("episodes", [20, 100, 500])
def test_a_wrong_decision_at_the_limit_keeps_its_level(outcomes, episodes):
    """Exactly, by the binomial distribution; Wilson's bounds did not (the next test)."""
    counts = np.arange(episodes + 1)
    found = [by_name(outcomes, at_fault=count, episodes=episodes)["at_fault"] for count in counts]
    high, low = (np.array([getattr(one, name) for one in found]) for name in ("high", "low"))
    for limit in (0.005, 0.01, 0.02, 0.05, 0.08, 0.1, 0.2, 0.5):
        chances = binom.pmf(counts, episodes, limit)
        assert chances[high <= limit].sum() <= 0.05, limit
        assert chances[low > limit].sum() <= 0.05 / 4, limit


def test_what_exact_bounds_cost_and_give():
    """The table of docs/audit.md: 500 episodes, a wrong pass at 5 %, a wrong fail at 5 % / 8."""
    limits = np.concatenate([np.arange(0.002, 0.1, 0.002), np.arange(0.1, 0.5, 0.01)])
    for interval, rates in ((wilson, (0.054, 0.021)), (clopper_pearson, (0.050, 0.006))):
        high = np.array([interval(count, 500, 0.9).high for count in range(501)])
        low = np.array([interval(count, 500, 1 - 0.1 / 8).low for count in range(501)])
        passes = max(binom.pmf(np.flatnonzero(high <= one), 500, one).sum() for one in limits)
        fails = max(binom.pmf(np.flatnonzero(low > one), 500, one).sum() for one in limits)
        assert (passes, fails) == pytest.approx(rates, abs=6e-4)
        good = [
            binom.pmf(np.flatnonzero(high <= one), 500, one / 2).sum() for one in (0.02, 0.05, 0.1)
        ]
        assert good == pytest.approx([0.44, 0.87, 0.995], abs=5e-3)


def delayed(outcomes, values, side="at most", limit=6.0, ends=(-50.0, 250.0), **errors):
    one = outcomes("policy", np.zeros((len(values), 2)), beside={"delay": np.array(values)})
    return bound_tests(one, [Bound("delay", side, limit, ends)], **errors)[0]


def test_a_mean_of_an_effect_is_tested_on_both_sides(outcomes):
    values = np.tile([-20.0, 0.0, 10.0, 30.0], 250)  # 5 m
    for side, limit, decision in (
        ("at most", 12.0, Decision.PASS),
        ("at most", 5.5, Decision.INCONCLUSIVE),
        ("at most", -2.0, Decision.FAIL),
        ("at least", -2.0, Decision.PASS),
        ("at least", 4.5, Decision.INCONCLUSIVE),
        ("at least", 12.0, Decision.FAIL),
    ):
        one = delayed(outcomes, values, side, limit)
        assert (one.decision, one.side) == (decision, side), one
        assert one.low < one.share == 5.0 < one.high
        assert (one.count, one.episodes, one.limit) == (0, 1000, limit)
        assert one.needed is not None and one.needed > 0


def test_an_effect_counts_within_its_range_and_the_others_are_counted(outcomes):
    one = delayed(outcomes, [-80.0, 0.0, 1000.0, 10.0] * 100)
    assert (one.count, one.share) == (200, (-50 + 0 + 250 + 10) / 4)
    assert one.decision is Decision.FAIL


def limited(outcomes, declared, values, ends, **fields):
    """Return what is said of limits of a policy whose delays are these."""
    bound = Bound("delay", "at most", 6.0, ends)
    profile = declared("intersection-caused", caused=(bound,), competence=FLOOR, **fields)
    delays = {"delay": np.array(values)}
    rows = np.zeros((len(values), 2))
    best = outcomes("best", rows, beside={"delay": np.zeros(len(values))})
    return faults_of_limits(profile, outcomes("policy", rows, beside=delays), best)


@pytest.mark.parametrize("beyond", [0, 10, 11])
def test_a_range_may_change_one_percent_of_the_episodes(outcomes, declared, beyond):
    values = np.repeat([7.0, 0.0], [beyond, 1000 - beyond])
    faults = limited(outcomes, declared, values, (-700.0, 6.5))
    assert bool(faults) == (beyond > 1000 * MOST_CUT)
    assert limited(outcomes, declared, values, (-700.0, 700.0)) == []


def test_a_mean_counts_in_full_where_few_episodes_are_beyond_the_range(outcomes, declared):
    (fault,) = limited(outcomes, declared, np.repeat([5000.0, 0.0], [5, 995]), (-700.0, 6.5))
    assert "the mean delay is 25 m" in fault and "at most 6 is declared" in fault


def test_a_mean_beyond_its_limit_that_no_range_cuts_is_left_to_its_test(outcomes, declared):
    assert limited(outcomes, declared, np.full(1000, 25.0), (-700.0, 700.0)) == []
    assert limited(outcomes, declared, np.repeat([5000.0, 8.0], [5, 995]), (-700.0, 700.0)) == []


def test_an_effect_that_is_an_event_has_an_exact_bound(outcomes):
    close = np.repeat([1.0, 0.0], [30, 170])
    one = outcomes("policy", np.zeros((200, 2)), beside={"gap_below_1_s": close})
    found = bound_tests(one, [Bound("gap_below_1_s", "at most", 0.25)])[0]
    assert (found.count, found.share, found.decision) == (30, 0.15, Decision.PASS)
    assert found.high == pytest.approx(binomtest(30, 200).proportion_ci(0.9, "exact").high)


def test_each_bound_has_its_part_of_a_wrong_fail(outcomes):
    one = outcomes("policy", np.zeros((200, 2)), beside={"delay": np.zeros(200)})
    tests = bound_tests(
        one, (*FLOOR.bounds, Bound("delay", "at most", 6.0, (-50.0, 250.0))), 0.05, 0.1
    )
    assert {one.fail_error for one in tests} == {0.1 / 5}
    assert {one.pass_error for one in tests} == {0.05}


@pytest.mark.parametrize("side", ["at most", "at least"])
@pytest.mark.parametrize("shape", ["light", "heavy"])
def test_a_driver_at_its_bound_passes_at_most_as_often_as_declared(outcomes, side, shape):
    """The mean is exactly the limit: every pass is wrong. 5 % of 200 audits, and 3 deviations."""
    rng, sign = np.random.default_rng([26, len(shape)]), 1.0 if side == "at most" else -1.0
    if shape == "light":
        values = rng.normal(6.0, 42.0, (200, 200)).clip(-244.0, 256.0)
    else:  # 200 m in one of 50 episodes, 2.04 m in the others
        values = np.where(rng.random((200, 200)) < 0.02, 200.0, (6.0 - 4.0) / 0.98)
        values = sign * (values - 6.0) + 6.0
    ends = (-250.0, 262.0)
    found = [delayed(outcomes, row, side, 6.0, ends).decision for row in values]
    assert sum(one is Decision.PASS for one in found) <= 200 * 0.05 + 3 * (200 * 0.05 * 0.95) ** 0.5
    assert sum(one is Decision.FAIL for one in found) <= 200 * 0.05 + 3 * (200 * 0.05 * 0.95) ** 0.5
