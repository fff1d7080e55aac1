"""The primary test and the compatible angles by hand."""

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from socialiq.audit.profile.profile import Floor
from socialiq.audit.verdict.calibration import compatible_angles
from socialiq.audit.verdict.regret import Decision, Regrets, regret_test
from socialiq.audit.verdict.verdict import floor_tests, joint_decision
from socialiq.statistics.intervals import clopper_pearson, episodes_needed, wilson
from socialiq.types import Ending, RewardPair


def test_one_that_fails_fails_all():
    passes, fails, undecided = Decision.PASS, Decision.FAIL, Decision.INCONCLUSIVE
    assert joint_decision([passes, passes]) is passes
    assert joint_decision([passes, undecided]) is undecided
    assert joint_decision([passes, undecided, fails]) is fails


def test_episodes_needed_by_hand():
    # ((1.644854 + 1.281552) * 2 / 0.5)^2 = 137.02
    assert episodes_needed(0.5, 2.0, 0.05) == 138
    assert episodes_needed(-0.5, 2.0, 0.05) == 138
    assert episodes_needed(0.0, 2.0, 0.05) is None
    assert episodes_needed(5.0, 0.0, 0.05) == 1


def made(found, angle=0.0, margin=0.5, **errors):
    regrets = Regrets(found, 0, 1000)
    return regret_test(regrets, angle, margin, **errors), regrets


@pytest.fixture(scope="module")
def noisy(outcomes, evidence):
    """The policy lacks 1 of r_env against "a", and 1 of r_social against "b"."""
    rng = np.random.default_rng(0)
    common = 3 * rng.normal(size=(600, 2))
    own = 0.5 * rng.normal(size=(3, 600, 2))
    own -= own.mean(axis=1, keepdims=True)
    return evidence(
        outcomes("policy", common + own[0]),
        outcomes("a", common + own[1] + [1.0, 0.0]),
        outcomes("b", common + own[2] + [0.0, 1.0]),
    )


@pytest.mark.parametrize(("angle", "best"), [(0.0, "a"), (30.0, "a"), (60.0, "b"), (90.0, "b")])
def test_regret_is_towards_the_best_at_the_angle(noisy, angle, best):
    found, _ = made(noisy, angle)
    radians = np.deg2rad(angle)
    assert found.best == best
    assert found.regret == pytest.approx(max(np.cos(radians), np.sin(radians)))
    assert found.low < found.regret < found.high
    by_name = {one.name: one.regret for one in found.references}
    assert by_name == pytest.approx({"a": np.cos(radians), "b": np.sin(radians)}, abs=1e-12)


def test_the_margin_decides(noisy):
    found = [made(noisy, margin=margin)[0] for margin in (0.8, 1.0, 1.2)]
    kinds = [Decision.FAIL, Decision.INCONCLUSIVE, Decision.PASS]
    assert [one.decision for one in found] == kinds
    assert found[1].needed is None or found[1].needed > 10**6  # it lies on the margin
    # σ of a difference is 0.5 √2, so ((1.645 + 1.282) 0.707 / 0.2)² = 107
    assert found[2].needed == pytest.approx(107, rel=0.1)


def test_common_episodes_cancel(noisy, outcomes, evidence):
    shuffled = evidence(
        noisy.policy, *(outcomes(one.name, one.totals[::-1]) for one in noisy.references)
    )
    paired, unpaired = (made(one)[0] for one in (noisy, shuffled))
    assert unpaired.regret == pytest.approx(paired.regret)
    assert unpaired.high - unpaired.low > 4 * (paired.high - paired.low)


def test_more_confidence_is_wider(noisy):
    narrow, wide = (made(noisy, pass_error=e, fail_error=e)[0] for e in (0.1, 0.01))
    assert wide.low < narrow.low < narrow.high < wide.high


def test_a_policy_may_be_better_than_all(outcomes, evidence):
    rng = np.random.default_rng(1)
    found, _ = made(
        evidence(
            outcomes("policy", rng.normal(size=(300, 2)) + 2.0),
            outcomes("a", rng.normal(size=(300, 2))),
        )
    )
    assert found.high < 0 and found.decision is Decision.PASS


def test_a_known_best_is_compared_alone(noisy, outcomes, evidence):
    """A reference that only looks better than the exact optimum isn't."""
    exact = [
        outcomes("a", noisy.references[0].totals, expected=RewardPair(2.0, 0.0)),
        outcomes("b", noisy.references[1].totals, expected=RewardPair(0.0, 2.0)),
        outcomes("lucky", noisy.references[0].totals + 5.0),
    ]
    found, regrets = made(evidence(noisy.policy, *exact))
    assert found.best == "a" and found.regret == pytest.approx(1.0)
    assert [one.compared for one in found.references] == [True, False, False]
    assert regret_test(regrets, 90.0, 1.0).best == "b"


def test_the_same_driver_has_no_regret_but_a_rest(outcomes, evidence):
    totals = np.random.default_rng(2).normal(size=(200, 2))
    found, _ = made(evidence(outcomes("policy", totals), outcomes("twin", totals)), margin=0.2)
    reach = np.ptp(totals[:, 0])
    assert found.regret == 0.0
    assert found.high == pytest.approx(reach * (1 - 0.05 ** (1 / 200)))
    assert found.decision is Decision.PASS
    assert found.needed is not None and found.needed < 200


def test_the_band_and_the_bounds_agree(noisy, outcomes, evidence):
    twin = evidence(noisy.policy, *noisy.references, outcomes("twin", noisy.policy.totals.copy()))
    regrets = Regrets(twin, 0, 1000)
    for angle in (0.0, 45.0, 200.0):
        low, high = regrets.low(angle, 0.02), regrets.highs(angle, 0.05).max()
        expected = {low - 1e-4: (False, True), low + 1e-4: (False, False)}
        expected |= {high - 1e-4: (False, False), high + 1e-4: (True, False)}
        for margin, found in expected.items():
            assert regrets.band(angle, margin, 0.05, 0.02) == found


def test_it_is_seeded(noisy):
    again, other = Regrets(noisy, 0, 300), Regrets(noisy, 1, 300)
    assert Regrets(noisy, 0, 300).low(20.0, 0.05) == again.low(20.0, 0.05)
    assert again.low(20.0, 0.05) != other.low(20.0, 0.05)


@pytest.fixture(scope="module")
def angles(outcomes, evidence):
    rng = np.random.default_rng(0)
    common, own = rng.normal(size=(400, 2)), 0.3 * rng.normal(size=(2, 400, 2))
    own -= own.mean(axis=1, keepdims=True)
    policy = outcomes("policy", common + own[0])
    made = evidence(policy, outcomes("ahead", common + own[1] + [1.0, 0.0]))
    return compatible_angles(Regrets(made, 0, 500), 0.5)


def test_one_reference_by_hand(angles):
    # cos α <= 1/2 from 60 to 300 degrees
    (arc,) = angles.arcs
    assert (arc.low, arc.high) == pytest.approx((60.0, 300.0))
    assert (angles.least_angle, angles.least) == (180.0, pytest.approx(-1.0))


def test_the_band_holds_the_arcs_between(angles):
    (sure,), (possible,) = angles.surely, angles.possibly
    assert 60.0 < sure.low < 66.0 and 294.0 < sure.high < 300.0
    assert 54.0 < possible.low < 60.0 and 300.0 < possible.high < 306.0


def test_the_best_of_all_is_rationalised_by_a_cone_only(outcomes, evidence):
    """A vertex is best where its normal cone is (support_intervals says where)."""
    from socialiq.evaluation.front import support_intervals

    noise = np.random.default_rng(3).normal(size=(2000, 2))
    points = {"policy": (1.0, 1.0), "ego": (2.0, -1.0), "altruist": (-1.0, 2.0)}
    drivers = [outcomes(name, noise + one) for name, one in points.items()]
    made = compatible_angles(Regrets(evidence(*drivers), 0, 300), 1e-9)
    (arc,) = made.arcs
    assert (arc.low, arc.high) == pytest.approx(support_intervals(points)["policy"])
    assert arc.holds(45.0) and not arc.holds(0.0)


def test_the_lower_bounds_of_rare_gains_share_the_error(outcomes, evidence):
    """By hand: both gain 1 in each of 100 episodes; p is Clopper-Pearson's bound of 0 of 100."""
    still = np.zeros((100, 2))
    ahead = still + np.array([1.0, 0.0])
    found, _ = made(
        evidence(
            outcomes("policy", still),
            outcomes("a", ahead),
            outcomes("b", ahead),
        ),
        fail_error=0.05,
    )
    share = 1.0 - 0.025 ** (1 / 100)
    assert found.low == pytest.approx(1.0 - 2.0 * share)


FLOOR = Floor(max_at_fault=0.1, max_struck=0.1, min_arrival=0.8, max_timeout=0.1)


def driver(outcomes, at_fault=0, struck=0, timeout=0, episodes=200):
    collided = [Ending.COLLISION] * (at_fault + struck) + [Ending.TIMEOUT] * timeout
    kinds = collided + [Ending.ARRIVAL] * (episodes - len(collided))
    contact = [1] * at_fault + [2] * struck + [0] * (episodes - at_fault - struck)
    return outcomes("driver", [[0.0, 0.0]] * episodes, kinds, contact)


def by_name(outcomes, floor=FLOOR, **events):
    return {one.name: one for one in floor_tests(driver(outcomes, **events), floor)}


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
