import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, ttest_ind, ttest_rel

from socialiq.errors import UserError
from socialiq.statistics.comparisons import holm, mean_contrast, paired_difference, share_contrast
from socialiq.statistics.intervals import clopper_pearson, wilson


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


def test_holm_by_hand():
    # sorted 0.01, 0.02, 0.03, 0.4 times 4, 3, 2, 1 is 0.04, 0.06, 0.06, 0.4
    assert holm([0.02, 0.4, 0.01, 0.03]).tolist() == pytest.approx([0.06, 0.4, 0.04, 0.06])


def test_holm_never_lets_a_larger_p_value_overtake():
    # 0.02 times 2 is 0.04, but 0.03 times 1 must not be less
    assert holm([0.03, 0.02]).tolist() == pytest.approx([0.04, 0.04])
    assert holm([0.9, 0.6, 0.5]).tolist() == [1.0, 1.0, 1.0]
    assert holm([]).tolist() == []


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holm_lies_between_the_p_value_and_bonferronis(p_values):
    given_, adjusted = np.array(p_values), holm(p_values)
    assert (adjusted >= given_).all()
    assert (adjusted <= np.minimum(given_ * len(given_), 1.0)).all()
    assert (np.diff(adjusted[np.argsort(given_, kind="stable")]) >= 0).all()


@pytest.mark.parametrize("p", [-0.1, 1.1, float("nan")])
def test_what_is_no_probability_is_refused(p):
    with pytest.raises(UserError, match="between 0 and 1"):
        holm([0.5, p])


def test_a_paired_difference_by_hand():
    # Differences 1, 2, 3: mean 2, standard error 1 / sqrt 3, t = 3.4641 with 2 degrees of
    # freedom. There p = 1 - t / sqrt(2 + t²), and t of 95 % is 4.302653.
    found = paired_difference([5.0, 7.0, 9.0], [4.0, 5.0, 6.0])
    t = 2 * math.sqrt(3)
    half = 4.302652729911275 / math.sqrt(3)
    assert found == pytest.approx((2.0, 2 - half, 2 + half, 1 - t / math.sqrt(2 + t * t)))


def test_a_paired_difference_is_scipys():
    first, second = np.random.default_rng(0).normal(size=(2, 10))
    found, there = paired_difference(first, second, 0.9), ttest_rel(first, second)
    interval = there.confidence_interval(0.9)
    assert found[1:] == pytest.approx((interval.low, interval.high, there.pvalue))


def test_what_both_share_drops_out_of_a_paired_difference():
    shared = np.array([10.0, -30.0, 50.0, 7.0])
    gain = np.array([1.0, 2.0, 1.0, 2.0])
    found = paired_difference(shared + gain, shared)
    assert found == pytest.approx(paired_difference(gain, np.zeros(4)))
    assert found.p < 0.05


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ([1.0, 2.0], [1.0, 2.0], (0.0, 0.0, 0.0, 1.0)),
        ([3.0, 4.0], [1.0, 2.0], (2.0, 2.0, 2.0, 0.0)),
        ([0.3, 0.2], [0.2, 0.1], (0.1, 0.1, 0.1, 0.0)),  # equal but for rounding
    ],
)
def test_equal_differences_have_no_spread(first, second, expected):
    assert paired_difference(first, second) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("first", "second", "line"),
    [
        ([1.0], [2.0], "at least two, got 1 and 1"),
        ([1.0, 2.0, 3.0], [1.0, 2.0], "the same replicates of both, at least two, got 3 and 2"),
        ([1.0, np.nan], [1.0, 2.0], "finite numbers"),
    ],
)
def test_replicates_that_do_not_pair_up_are_refused(first, second, line):
    with pytest.raises(UserError, match=line):
        paired_difference(first, second)


def test_welch_is_scipys():
    rng = np.random.default_rng(0)
    first, second = rng.normal(1.0, 3.0, 30), rng.normal(0.0, 1.0, 50)
    found = mean_contrast(first, second, 0.9)
    theirs = ttest_ind(first, second, equal_var=False).confidence_interval(0.9)
    assert found.value == pytest.approx(first.mean() - second.mean())
    assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high))
    assert mean_contrast(np.full(3, 2.0), np.full(4, 0.5)) == (1.5, 1.5, 1.5)
    with pytest.raises(UserError, match="fewer than two"):
        mean_contrast(np.zeros(1), np.zeros(5))


def test_newcombe_as_he_printed_it():
    """56 of 70 less 48 of 80: 0.0524 to 0.3339 (Newcombe 1998, Table II, method 10, case a)."""
    found = share_contrast(56, 70, 48, 80)
    assert found.value == pytest.approx(0.2)
    assert (round(found.low, 4), round(found.high, 4)) == (0.0524, 0.3339)
    nothing = share_contrast(0, 10, 0, 20)  # his case e: -0.1611 to 0.2775
    assert (round(nothing.low, 4), round(nothing.high, 4)) == (-0.1611, 0.2775)
