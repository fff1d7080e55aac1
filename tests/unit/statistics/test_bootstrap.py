"""Bounds of the largest mean: against Student's, against each other, and by counting."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from socialiq.social.angle import exact_weights
from socialiq.statistics import bootstrap
from socialiq.statistics.bootstrap import (
    Moments,
    Studentised,
    largest_exceeds,
    largest_lower_bound,
    upper_bounds,
)


def studentised(gains, angle=0.0, seed=0, resamples=4000):
    moments = Moments.of(np.asarray(gains, np.float64), seed, resamples)
    return moments.at(exact_weights(angle), np.arange(len(gains)))


@pytest.fixture(scope="module")
def gains():
    rng = np.random.default_rng(1)
    means = np.array([[0.5, 0.0], [0.4, 0.3], [-2.0, 1.0]])
    common = rng.normal(size=(1, 400, 2))
    return means[:, None] + common + 0.5 * rng.normal(size=(3, 400, 2))


@pytest.mark.parametrize("angle", [0.0, 37.0, 200.0])
def test_means_and_errors_are_those_of_the_scalar(gains, angle):
    found = studentised(gains, angle)
    radians = np.deg2rad(angle)
    scalar = gains[..., 0] * np.cos(radians) + gains[..., 1] * np.sin(radians)
    np.testing.assert_allclose(found.mean, scalar.mean(axis=1))
    np.testing.assert_allclose(found.error, scalar.std(axis=1, ddof=1) / 20)
    # One resample by hand: its t is (resampled mean - mean) / resampled standard error.
    rows = np.random.default_rng(0).integers(400, size=(2500, 400))[7]
    drawn = scalar[:, rows]
    expected = (drawn.mean(axis=1) - scalar.mean(axis=1)) / (drawn.std(axis=1, ddof=1) / 20)
    np.testing.assert_allclose(found.resampled[7], expected)


def test_few_draws_are_kept_and_many_are_made_again(gains, monkeypatch):
    kept = Moments.of(gains, 3, 4000)
    monkeypatch.setattr(bootstrap, "_KEPT", 0)
    made = Moments.of(gains, 3, 4000)
    for one, other in zip(kept, made, strict=True):
        np.testing.assert_array_equal(one, other)


def test_normal_data_have_students_bounds(gains):
    found = studentised(gains[:1])
    interval = ttest_1samp(gains[0, :, 0], 0).confidence_interval(0.9)
    half = (interval.high - interval.low) / 2
    assert upper_bounds(found, 0.05)[0] == pytest.approx(interval.high, abs=0.08 * half)
    assert largest_lower_bound(found, 0.05) == pytest.approx(interval.low, abs=0.08 * half)


def test_the_lower_bound_is_where_the_test_changes(gains):
    found = studentised(gains)
    low = largest_lower_bound(found, 0.05)
    assert low < found.mean.max()
    assert largest_exceeds(found, low - 1e-6, 0.05) and not largest_exceeds(found, low + 1e-6, 0.05)


def test_a_hopeless_reference_costs_next_to_nothing(gains):
    alone, beside = (
        largest_lower_bound(studentised(gains[rows]), 0.05) for rows in ([0], [0, 2, 2, 2])
    )
    several = largest_lower_bound(studentised(gains[[0, 0, 0, 0]]), 0.05)
    error = studentised(gains[:1]).error[0]
    # What it does cost is the tenth of the error that telling so takes.
    assert alone - 0.15 * error < beside < alone
    assert several == pytest.approx(beside, abs=0.05 * error)  # copies are perfectly correlated


def test_ties_cost_something():
    rng = np.random.default_rng(2)
    gains = rng.normal(size=(8, 500, 2))
    found = studentised(gains)
    shared = (largest_lower_bound(found, 0.05) - found.mean.max()) / found.error.max()
    assert shared < -2.0  # alone it is -1.64


def test_skewness_is_corrected():
    # Rare large losses: the normal upper bound of their mean is too low too often.
    held = {"bootstrap": 0, "normal": 0}
    for seed in range(300):
        gains = np.zeros((1, 150, 2))
        gains[0, :, 0] = np.random.default_rng(seed + 10_000).exponential(1.0, 150) ** 1.5
        found = studentised(gains, seed=seed, resamples=500)
        truth = 1.3293403881791368  # Γ(2.5)
        held["bootstrap"] += upper_bounds(found, 0.05)[0] >= truth
        held["normal"] += found.mean[0] + 1.6449 * found.error[0] >= truth
    assert held["bootstrap"] > held["normal"]
    assert held["bootstrap"] >= 0.9 * 300


def test_the_first_step_takes_a_tenth_of_the_error():
    """By hand: the second reference may be at the limit, so it must not be lowered.

    The least of each resample is that of the second, uniform in [-1, 1]: its upper bound at a tenth
    of 5 % is -0.95 + 0.99, above the limit of 0. The critical value is then the 95.5th percentile
    of its resamples, 0.91, and 0.88 does not exceed it. At the whole error the bound would be
    -0.05, the resamples lowered by that, and the critical value 0.86.
    """
    uniform = np.linspace(-1.0, 1.0, 2001)
    resampled = np.stack([0.5 * np.maximum(uniform, 0.0), uniform], axis=1)
    found = Studentised(np.array([0.88, -0.95]), np.ones(2), resampled)
    assert not largest_exceeds(found, 0.0, 0.05)
    clearly = Studentised(np.array([0.92, -0.95]), np.ones(2), resampled)
    assert largest_exceeds(clearly, 0.0, 0.05)
