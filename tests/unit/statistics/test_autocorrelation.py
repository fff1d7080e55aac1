"""Autocorrelation of short series of pairs."""

import numpy as np
import pytest

from socialiq.statistics.autocorrelation import (
    CORRELATIONS,
    fit_serial,
    mean_of,
    worth_of_mean,
)


@pytest.mark.parametrize("count", [1, 2, 7])
@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_the_worth_and_the_mean_are_those_of_the_matrix(count, rho):
    places = np.arange(count)
    inverse = np.linalg.inv(rho ** np.abs(places[:, None] - places))
    assert worth_of_mean(count, np.array(rho)) == pytest.approx(inverse.sum())
    pairs = np.random.default_rng(0).normal(size=(count, 2))
    expected = inverse.sum(axis=0) @ pairs / inverse.sum()
    np.testing.assert_allclose(mean_of(pairs, rho), expected)


def series(rho, count, length, rng):
    found = []
    for _ in range(count):
        one = [rng.standard_normal(2)]
        for _ in range(length - 1):
            one.append(rho * one[-1] + np.sqrt(1 - rho**2) * rng.standard_normal(2))
        found.append(rng.normal(0, 5, 2) + [1.0, 2.0] * np.array(one))
    return found


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_short_series_with_means_of_their_own_show_the_correlation(rho):
    """Series of six: the plain estimate of ρ = 0 would be -1/6."""
    found = fit_serial(series(rho, 300, 6, np.random.default_rng(1)))
    assert found.correlation == pytest.approx(rho, abs=0.06)
    np.testing.assert_allclose(np.diag(found.covariance), [1.0, 4.0], rtol=0.25)
    assert found.worth(6) == pytest.approx(worth_of_mean(6, np.array(rho)), abs=0.6)


def test_series_that_do_not_vary_are_worth_little():
    constant = [np.tile([-0.15, 2.0], (9, 1))]
    assert fit_serial(constant).correlation > 0.9
    assert fit_serial(constant).worth(9) < 1.5


def test_series_of_one_row_say_nothing():
    found = fit_serial([np.ones((1, 2)), np.zeros((1, 2))])
    np.testing.assert_allclose(found.chance, 1 / len(CORRELATIONS))
    assert found.worth(1) == pytest.approx(1.0)
    assert fit_serial([]).worth(1) == pytest.approx(1.0)
