"""The regret test and the compatible angles by hand."""

import numpy as np
import pytest

from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets, compatible_angles, regret_test
from socialiq.types import RewardPair


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
