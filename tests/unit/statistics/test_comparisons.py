import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_ind, ttest_rel

from socialiq.errors import UserError
from socialiq.statistics.comparisons import (
    cohens_d,
    holm,
    mean_contrast,
    paired_difference,
    share_contrast,
)


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


def test_cohens_d_by_hand():
    # Means 2 and 4; variances 1 and 4 with 2 degrees of freedom each pool to 2.5.
    d = cohens_d(np.array([1.0, 2.0, 3.0]), np.array([2.0, 4.0, 6.0]))
    assert d == pytest.approx(-2.0 / math.sqrt(2.5))
    # Unequal sizes: squares 0.5 + 2 over 3 degrees of freedom.
    d = cohens_d(np.array([1.0, 2.0]), np.array([0.0, 1.0, 2.0]))
    assert d == pytest.approx(0.5 / math.sqrt(2.5 / 3))


def test_cohens_d_of_constant_groups():
    assert cohens_d(np.full(3, 2.0), np.full(2, 2.0)) == 0.0
    assert cohens_d(np.full(3, 1.0), np.full(2, 2.0)) == -math.inf
    with pytest.raises(UserError, match="at least two values"):
        cohens_d(np.zeros(1), np.zeros(3))
