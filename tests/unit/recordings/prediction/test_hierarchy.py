"""Posteriors by driver: exact small cases, and a population that is recovered."""

import numpy as np
import pytest

from socialiq_recordings.prediction.hierarchy import (
    driver_log_likelihood,
    driver_posteriors,
    driver_prior,
    populations,
)

ANGLES = np.linspace(0.0, 90.0, 7)


def test_two_decisions_by_hand():
    """Likelihoods .5 and .1, then .4 and .9: .2 and .09 under a prior of .8 and .2."""
    of_decision = np.log([[[0.5, 0.1]], [[0.4, 0.9]]])
    total = driver_log_likelihood(of_decision, np.array([1, 1]), 3)
    np.testing.assert_allclose(np.exp(total[1, 0]), [0.2, 0.09])
    assert not total[[0, 2]].any()  # drivers without a decision
    posterior = driver_posteriors(total, np.array([[0.8, 0.2]]))
    np.testing.assert_allclose(posterior[1, 0], np.array([0.16, 0.018]) / 0.178)
    np.testing.assert_allclose(posterior[0, 0], [0.8, 0.2])


@pytest.mark.parametrize("far", [0.0, -1e3])
def test_the_driver_is_integrated_out_by_hand(far: float):
    two = np.array([[0.8, 0.2], [0.3, 0.7]])
    found = driver_prior(np.log([[[0.2, 0.09]]]) + far, two)
    np.testing.assert_allclose(found[0], np.array([0.178, 0.123]) / 0.301 @ two)


def test_populations_are_normal_and_those_without_spread_are_at_their_means():
    found = populations(ANGLES, np.array([0.0, 30.0])).reshape(7, 2, 7)
    np.testing.assert_array_equal(found[:, 0], np.eye(7))
    np.testing.assert_allclose(found.sum(axis=2), 1.0)
    np.testing.assert_allclose(found[3, 1, 5] / found[3, 1, 3], np.exp(-0.5))


@pytest.mark.parametrize(("spread", "low", "high"), [(0.0, 0.0, 5.0), (25.0, 15.0, 35.0)])
def test_the_spread_of_drivers_is_recovered(spread: float, low: float, high: float):
    """Drivers with twelve observations each of their angle, normal with a deviation of 20°."""
    rng, drivers = np.random.default_rng(5), np.repeat(np.arange(150), 12)
    angle = np.clip(45.0 + spread * rng.standard_normal(150), 0.0, 90.0)[drivers]
    observed = angle + 20.0 * rng.standard_normal(len(drivers))
    of_decision = -0.5 * ((observed[:, None, None] - ANGLES) / 20.0) ** 2
    likelihood = driver_log_likelihood(of_decision, drivers, 150)
    [prior] = driver_prior(likelihood, populations(ANGLES, ANGLES))
    mean = prior @ ANGLES
    assert mean == pytest.approx(45.0, abs=5.0)
    assert low <= np.sqrt(prior @ (ANGLES - mean) ** 2) <= high
