"""Spread of shown angles: exact likelihoods, and populations of known spread."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from socialiq_recordings.census_spread import deconvolve, log_direction_likelihood


def test_the_likelihood_is_the_integral():
    point, covariance = np.array([0.4, -0.2]), np.array([[0.3, 0.1], [0.1, 0.2]])
    angle = np.array([0.0, 45.0, 180.0, -100.0])
    for alpha, found in zip(angle, log_direction_likelihood(point, covariance, angle), strict=True):
        way = np.array([np.cos(np.radians(alpha)), np.sin(np.radians(alpha))])
        whole, _ = quad(
            lambda r, way=way: multivariate_normal.pdf(point, r * way, covariance), 0, np.inf
        )
        assert found == pytest.approx(np.log(whole), abs=1e-6)


def drivers(spread, rng, count=120, decisions=4, noise=0.5):
    angle = np.radians(20.0 + spread * rng.standard_normal(count))
    points = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return [one + noise * rng.standard_normal((decisions, 2)) for one in points]


@pytest.mark.parametrize("spread", [0.0, 30.0])
def test_the_spread_is_that_of_the_drivers_not_of_the_noise(spread):
    rng = np.random.default_rng(4)
    pairs = drivers(spread, rng)
    found = deconvolve(pairs, np.arange(120), seed=0, resamples=20).population
    shown = np.array([np.degrees(np.arctan2(*one.mean(axis=0)[::-1])) for one in pairs])
    assert found.low <= spread <= found.high
    assert abs(found.spread - spread) <= 10.0
    if spread == 0.0:
        assert shown.std() > 12.0 > found.spread  # what the angles alone would say
    assert found.mean.low - 1e-9 <= 20.0 <= found.mean.high + 1e-9
    assert found.chain_low is not None and found.chain_low <= found.chain_high


def test_drivers_who_show_little_are_close_to_the_population():
    rng = np.random.default_rng(1)
    pairs = drivers(10.0, rng, count=40, decisions=12, noise=0.3)
    pairs += [np.array([[-0.1, 0.0]])]  # one decision, behind the origin
    found = deconvolve(pairs, np.arange(41), seed=0, resamples=5)
    assert abs(found.drivers[-1].angle - 20.0) < 20.0
    widths = [one.high - one.low for one in found.drivers]
    assert widths[-1] > np.median(widths[:-1])


def test_single_decisions_show_no_spread():
    """If no driver decides twice, differences may all be error."""
    points = drivers(60.0, np.random.default_rng(2), count=30, decisions=1, noise=0.0)
    found = deconvolve(points, np.arange(30), seed=0, resamples=5).population
    assert found.low == 0.0 and found.high >= 60.0


def test_one_chain_has_no_interval_over_chains():
    found = deconvolve([np.ones((2, 2)), np.ones((1, 2))], np.zeros(2, np.int64), seed=0)
    assert found.population.chain_low is None and found.population.chains == 1
    assert len(found.drivers) == 2
