"""Drivers of known angles who decide at given moments."""

import numpy as np
import pytest

from socialiq_recordings.trait.models import sample_of
from socialiq_recordings.trait.power import (
    Planted,
    before,
    decide,
    known_angle_gain,
    larger_sample,
    strength_of_gain,
)


@pytest.fixture(scope="module")
def sample(choices):
    return sample_of(choices(np.zeros(10), each=8, together=2))


def test_a_larger_sample_repeats_whole_chains_with_new_drivers(sample):
    same, rows = larger_sample(sample, 1, np.random.default_rng(0))
    np.testing.assert_array_equal(np.sort(rows), np.arange(80))
    assert len(same.chain) == 10 and same.chain.max() == 4
    larger, rows = larger_sample(sample, 3, np.random.default_rng(0))
    assert larger.chain.max() + 1 == 15 and len(larger.chain) == 30 and len(larger.table) == 240
    np.testing.assert_array_equal(np.bincount(larger.driver), 8)
    np.testing.assert_array_equal(larger.table.r_env, sample.table.r_env[rows])
    np.testing.assert_array_equal(larger.chain[larger.driver], larger.table.chain)


def test_choices_are_drawn_with_their_probability(choices):
    table = choices([0.0], each=2)
    many = sample_of(table.rows(np.repeat(np.arange(len(table)), 20_000)))
    drawn = decide(many, np.zeros((1, 2)), np.random.default_rng(0)).table
    share = np.bincount(drawn.chosen, minlength=7) / len(drawn)
    np.testing.assert_allclose(share, np.exp(table.log_base[0]), atol=0.01)


def test_the_decision_before_is_the_drivers_own():
    driver, time = np.array([0, 1, 0, 1]), np.array([2.0, 0.0, 1.0, 5.0])
    found = before(np.array([10.0, 20.0, 30.0, 40.0]), driver, time)
    assert found.tolist() == [30.0, 0.0, 0.0, 20.0]


def test_the_gain_of_known_angles_by_simulation(sample):
    """The closed form beside drawn choices, predicted with and without the angle."""
    planted = Planted(40.0, 20.0, 3.0)
    rng = np.random.default_rng(0)
    many, _ = larger_sample(sample, 400, rng)
    angle = planted.mean + planted.spread * rng.standard_normal(len(many.chain))
    table = decide(many, planted.weights(angle), rng).table
    rows = many.second

    def means(weights):
        score = table.log_base + weights[:, :1] * table.r_env + weights[:, 1:] * table.r_social
        chance = np.exp(score - score.max(axis=1, keepdims=True))
        return (chance / chance.sum(axis=1, keepdims=True)) @ table.grid

    known = means(planted.weights(angle)[many.driver])
    quantiles = planted.mean + planted.spread * np.linspace(-2.5, 2.5, 41)
    density = np.exp(-0.5 * np.linspace(-2.5, 2.5, 41) ** 2)
    each = np.array([means(np.repeat(planted.weights(q[None]), len(table), 0)) for q in quantiles])
    marginal = np.average(each, axis=0, weights=density)
    error = [np.mean((table.acceleration - one)[rows] ** 2) for one in (known, marginal)]
    assert known_angle_gain(sample, planted) == pytest.approx(
        1 - np.sqrt(error[0] / error[1]), abs=0.01
    )
    assert known_angle_gain(sample, planted._replace(spread=0.0)) == pytest.approx(0.0)


def test_the_strength_of_a_gain_gives_that_gain(sample):
    strength = strength_of_gain(sample, 35.0, 30.0, 0.05)
    assert strength is not None
    assert known_angle_gain(sample, Planted(35.0, 30.0, strength)) == pytest.approx(0.05, abs=2e-3)
    assert strength_of_gain(sample, 1.0, 30.0, 0.9) is None
