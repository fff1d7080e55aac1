"""Intervals of shares: by hand, and as SciPy has them."""

import pytest
from scipy.stats import binomtest

from socialiq.errors import UserError
from socialiq.statistics.intervals import clopper_pearson, episodes_needed, wilson


def test_wilson_by_hand():
    share = wilson(10, 100)
    z2, n, p = 1.959963984540054**2, 100, 0.1
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = (z2 * (p * (1 - p) / n + z2 / (4 * n * n))) ** 0.5 / (1 + z2 / n)
    assert share.value == 0.1
    assert share.low == pytest.approx(centre - half)
    assert share.high == pytest.approx(centre + half)


def test_nothing_counted_still_has_an_upper_end():
    share = wilson(0, 50)
    assert share.value == share.low == 0
    assert 0.05 < share.high < 0.09


def test_clopper_pearson_by_hand():
    # None of n: the upper end solves (1 - p)^n = 0.025. All of n: the lower end solves p^n = 0.025.
    none, every = clopper_pearson(0, 50), clopper_pearson(50, 50)
    assert none.low == 0.0 and none.high == pytest.approx(1 - 0.025 ** (1 / 50))
    assert every.high == 1.0 and every.low == pytest.approx(0.025 ** (1 / 50))
    # One of two: p² = 0.025 below, (1 - p)² = 0.025 above.
    one = clopper_pearson(1, 2)
    assert one.value == 0.5
    assert one.low == pytest.approx(1 - 0.975**0.5) and one.high == pytest.approx(0.975**0.5)


@pytest.mark.parametrize(("count", "trials"), [(0, 7), (7, 7), (3, 7), (1, 500), (480, 500)])
def test_clopper_pearson_is_scipys(count, trials):
    for confidence in (0.8, 0.95, 0.9875):
        theirs = binomtest(count, trials).proportion_ci(confidence, method="exact")
        found = clopper_pearson(count, trials, confidence)
        assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


@pytest.mark.parametrize("interval", [wilson, clopper_pearson])
def test_no_trial_is_refused(interval):
    with pytest.raises(UserError, match="at least one trial"):
        interval(0, 0)


def test_episodes_needed_by_hand():
    # ((1.644854 + 1.281552) * 2 / 0.5)^2 = 137.02
    assert episodes_needed(0.5, 2.0, 0.05) == 138
    assert episodes_needed(-0.5, 2.0, 0.05) == 138
    assert episodes_needed(0.0, 2.0, 0.05) is None
    assert episodes_needed(5.0, 0.0, 0.05) == 1
