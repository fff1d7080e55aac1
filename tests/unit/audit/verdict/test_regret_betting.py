"""The regret's bounds with a declared largest loss: which decide, and what breaks them."""

import numpy as np
import pytest

from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets, exceeds, loss_bounds, needed_with, regret_test
from socialiq.types import RewardPair

EPISODES = 400


def decided(found, largest_loss, margin=0.5, angle=0.0):
    regrets = Regrets(found, 0, 300, largest_loss)
    return regret_test(regrets, angle, margin)


@pytest.fixture(scope="module")
def lagging(outcomes, evidence):
    """The policy lacks exactly `lag` of r_env against "a" in the mean."""

    def made(lag, **more):
        rng = np.random.default_rng(0)
        own = rng.normal(size=(2, EPISODES, 2)).clip(-3.0, 3.0)
        own -= own.mean(axis=1, keepdims=True)
        reference = outcomes("a", own[1] + [lag, 0.0], **more)
        return evidence(outcomes("policy", own[0]), reference)

    return made


def test_the_bound_by_betting_decides(lagging):
    usual, guarded = (decided(lagging(0.1), loss) for loss in (None, 20.0))
    assert (usual.bound, usual.largest_loss, usual.low, usual.high) == (
        "bootstrap",
        None,
        usual.bootstrap_low,
        usual.bootstrap_high,
    )
    assert guarded.bound == "betting" and guarded.largest_loss == 20.0
    assert (guarded.bootstrap_low, guarded.bootstrap_high) == (usual.low, usual.high)
    assert guarded.low < usual.low < usual.high < guarded.high
    assert guarded.references[0].high == guarded.high
    assert usual.decision is guarded.decision is Decision.PASS


@pytest.mark.parametrize("largest_loss", [None, 20.0])
@pytest.mark.parametrize("angle", [0.0, 60.0])
def test_decisive_regrets_have_the_bounds_that_decide(outcomes, evidence, largest_loss, angle):
    """Of two references with exact expectations the better one at the angle is compared alone."""
    own = np.random.default_rng(0).normal(size=(3, EPISODES, 2)).clip(-3.0, 3.0)
    references = (
        outcomes("a", own[1] + [0.3, 0.0], expected=RewardPair(1.0, 0.0)),
        outcomes("b", own[2] + [0.0, 0.3], expected=RewardPair(0.0, 1.0)),
    )
    found = evidence(outcomes("policy", own[0]), *references)
    whole, decisive = (
        regret_test(Regrets(found, 0, 300, largest_loss, decisive=quick), angle, 0.5)
        for quick in (False, True)
    )
    compared = [one for one in whole.references if one.compared]
    assert list(decisive.references) == compared and len(compared) == 1
    names = ("decision", "low", "high", "regret", "best", "seen_loss", "broken")
    assert [getattr(decisive, n) for n in names] == [getattr(whole, n) for n in names]


@pytest.mark.parametrize(
    ("lag", "largest_loss", "decision"),
    [
        (0.0, 20.0, Decision.PASS),
        (0.0, 2000.0, Decision.INCONCLUSIVE),  # 3 of 2,000 in 400 episodes is far above 0.5
        (0.45, 20.0, Decision.INCONCLUSIVE),
        (2.0, 20.0, Decision.FAIL),
        (2.0, 2000.0, Decision.INCONCLUSIVE),
    ],
)
def test_the_price_of_a_larger_loss(lagging, lag, largest_loss, decision):
    found = decided(lagging(lag), largest_loss)
    assert found.decision is decision and not found.broken
    assert found.low < found.regret < found.high
    if decision is Decision.INCONCLUSIVE:
        assert found.needed is not None and found.needed > EPISODES


def test_a_loss_beyond_the_declared_one_fails_whatever_the_mean(lagging):
    found = decided(lagging(-0.5), 3.0)
    assert found.broken and found.decision is Decision.FAIL
    assert (found.seen_loss, found.seen_against) == (found.high, "a")
    assert found.seen_loss == pytest.approx(4.0, abs=0.6)


def test_a_loss_of_the_reference_breaks_nothing_but_the_lower_bound(lagging):
    made = lagging(-4.0)  # every loss of the policy is below 2.5, the largest of "a" is about 8
    found = decided(made, 6.0)
    assert not found.broken and found.decision is Decision.PASS
    losses = made.references[0].totals[:, 0] - made.policy.totals[:, 0]
    assert losses.min() < -6.0 and found.low == losses.min()


def test_only_the_compared_references_can_break_it(outcomes, evidence):
    totals = np.zeros((60, 2))
    best = outcomes("best", totals + np.array([0.1, 0.0]), expected=RewardPair(0.1, 0.0))
    other = outcomes("other", totals + np.array([50.0, 0.0]), expected=RewardPair(0.0, 1.0))
    found = decided(evidence(outcomes("policy", totals), best, other), 10.0)
    assert not found.broken and found.seen_against == "best"


def test_rounding_errors_break_nothing():
    largest = 0.1 + 0.2
    assert not exceeds(largest, 0.3) and exceeds(0.3001, 0.3)
    losses = np.full((1, 100), largest)
    bounds = loss_bounds(losses, np.array([True]), 0.25, 0.3, 0.05, 0.05)
    assert bounds.highs[0] == 0.3 and bounds.low < 0.3


def test_every_compared_reference_must_be_decided_for_a_pass():
    losses = np.stack([np.full(200, -5.0), np.full(200, 0.4)])
    both, first = np.array([True, True]), np.array([True, False])
    few, many = (needed_with(losses, rows, 0.5, 20.0, 0.05) for rows in (first, both))
    assert few is not None and many is not None and many > 20 * few
    assert needed_with(losses, both, 0.4, 20.0, 0.05) is None  # on the margin


def test_a_fail_needs_the_best_reference_alone():
    losses = np.stack([np.full(200, 0.0), np.full(200, 2.0)])
    needed = needed_with(losses, np.array([True, True]), 1.0, 10.0, 0.025)
    # (1 + 0.9 (2 - 1) / (10 + 1))^n = 40
    assert needed == pytest.approx(np.log(40) / np.log1p(0.9 / 11), abs=1)
