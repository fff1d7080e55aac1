"""Means by cluster and sign flips, by hand."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.statistics.clusters import (
    cluster_mean,
    clusters_needed,
    least_p,
    sign_flips,
)


def test_the_p_value_of_three_sums_is_counted_by_hand():
    """Of 8 patterns of (1, 2, 4) two reach 7, and four reach 5: ±(−1 + 2 + 4) and ±7."""
    assert sign_flips(np.array([[1.0, 2.0, 4.0]]), seed=0).p[0] == pytest.approx(2 / 8)
    assert sign_flips(np.array([[-1.0, 2.0, 4.0]]), seed=0).p[0] == pytest.approx(4 / 8)
    assert sign_flips(np.zeros((1, 4)), seed=0).p[0] == 1.0


def test_many_sums_are_drawn_and_never_give_zero():
    sums = np.ones((1, 40))
    assert 0.0 < sign_flips(sums, seed=0, draws=999).p[0] <= 2 / 1000
    assert sign_flips(sums, 3, 200).p == sign_flips(sums, 3, 200).p


def test_the_sign_flip_test_keeps_its_level():
    rng = np.random.default_rng(1)
    p = np.array([sign_flips(rng.standard_normal((1, 8)), 0).p[0] for _ in range(1000)])
    assert (p <= 0.05).mean() < 0.07


def test_tests_corrected_together_by_hand():
    # All signs alike give test 1 its 3 / sqrt(3) in 2 of 8 patterns, and test 2 its own in 2 more.
    found = sign_flips(np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0]]), 0)
    assert found.p.tolist() == [2 / 8, 1.0]
    assert found.corrected.tolist() == [4 / 8, 1.0]


def test_equal_tests_cost_nothing_and_a_test_without_rows_finds_nothing():
    sums = np.array([2.0, 1.0, 3.0, 2.0, 1.0, -0.5])
    found = sign_flips(np.stack([sums, 3 * sums, 0 * sums]), 0)
    assert found.p[0] == found.corrected[0] == found.corrected[1]
    assert found.corrected[2] == 1.0


def test_the_family_keeps_its_level_beside_a_real_difference():
    rng, false = np.random.default_rng(2), 0
    for _ in range(300):
        sums = rng.standard_normal((6, 8))
        sums[0] += 4.0
        found = sign_flips(sums, 0)
        false += bool((found.corrected[1:] <= 0.05).any())
        assert (found.corrected >= found.p - 1e-12).all()
    assert false / 300 < 0.08


def test_rows_of_a_cluster_count_as_one():
    rng = np.random.default_rng(0)
    values = np.repeat(rng.standard_normal(30), 10)
    rows, cluster = np.arange(300), np.repeat(np.arange(30), 10)
    apart = cluster_mean(values, rows, seed=0)
    together = cluster_mean(values, cluster, seed=0)
    assert apart.mean == together.mean == pytest.approx(values.mean())
    widths = apart.high - apart.low, together.high - together.low
    assert 2.3 < widths[1] / widths[0] < 4.2  # sqrt(10) = 3.2
    assert (apart.clusters, together.clusters) == (300, 30)


def test_one_cluster_has_no_interval():
    found = cluster_mean(np.array([1.0, 2.0]), np.array([7, 7]), seed=0)
    assert np.isnan(found.low) and found.clusters == 1
    with pytest.raises(UserError, match="at least one row"):
        cluster_mean(np.zeros(0), np.zeros(0, np.int64), seed=0)


def test_clusters_needed_are_those_whose_least_p_is_small_enough():
    assert least_p(1) == 1.0 and least_p(7) == 1 / 64
    for error in (0.05, 0.01):
        needed = clusters_needed(error)
        assert least_p(needed) <= error < least_p(needed - 1)
