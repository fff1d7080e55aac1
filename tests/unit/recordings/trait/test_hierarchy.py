"""Posteriors of traits: exact small cases, and coverage."""

import numpy as np
import pytest

from socialiq_recordings.trait.hierarchy import (
    Population,
    direction,
    driver_log_likelihood,
    driver_posteriors,
    infer,
    log_marginal,
    population_posterior,
    weighted_quantiles,
)
from socialiq_recordings.trait.traits import Trait, angle_trait, evaluate, reward_scale

TWO = Trait(
    shared=np.array([1.0]),
    value=np.array([0.0, 90.0]),
    weights=np.array([[[1.0, 0.0], [0.0, 1.0]]]),
    mean=np.array([0.0, 90.0]),
    spread=np.zeros(2),
    population=np.array([[0.8, 0.2], [0.3, 0.7]]),
)


def test_two_decisions_by_hand():
    """Likelihoods .5 and .1, then .4 and .9: .2 and .09 under a prior of .8 and .2."""
    of_decision = np.log([[[0.5, 0.1]], [[0.4, 0.9]]])
    total = driver_log_likelihood(of_decision, np.array([1, 1]), 3)
    np.testing.assert_allclose(np.exp(total[1, 0]), [0.2, 0.09])
    assert not total[[0, 2]].any()  # drivers without a decision
    known = Population(TWO, np.array([[1.0, 0.0]]))
    posterior = driver_posteriors(total, known)
    np.testing.assert_allclose(posterior[1, 0], np.array([0.16, 0.018]) / 0.178)
    np.testing.assert_allclose(posterior[0, 0], [0.8, 0.2])


def test_the_trait_is_integrated_out_by_hand():
    likelihood = np.log([[[0.2, 0.09]], [[1e-200, 1e-200]]])
    spread = TWO._replace(spread=np.ones(2))
    found = log_marginal(likelihood, spread)
    np.testing.assert_allclose(np.exp(found[0, 0]), [0.178, 0.3 * 0.2 + 0.7 * 0.09])
    np.testing.assert_allclose(found[1, 0], np.log(1e-200))
    population = population_posterior(found, spread)
    np.testing.assert_allclose(population.chance[0], np.array([0.178, 0.123]) / 0.301)
    np.testing.assert_allclose(population.driver_prior[0], population.chance[0] @ TWO.population)
    left_out = population_posterior(found, spread, np.zeros(2))
    np.testing.assert_allclose(left_out.chance[0], [0.5, 0.5])


def test_all_alike_needs_no_integral():
    trait = angle_trait(30.0, strengths=(0.0, 1.0))
    likelihood = np.random.default_rng(0).normal(size=(3, 2, 12))
    alike = trait.alike()
    np.testing.assert_allclose(log_marginal(likelihood, alike), likelihood)


def test_a_drivers_chain_is_not_in_its_population(choices):
    """Changing the decisions of a chain leaves the population of that chain's drivers alone."""
    table = choices([0.0, 0.0, 90.0, 90.0, 45.0], together=1)
    trait = angle_trait(30.0, strengths=(0.5, 1.0, 2.0))
    likelihood = driver_log_likelihood(evaluate(table, trait).log_likelihood, table.driver, 5)
    chain = np.array([0, 0, 1, 1, 2])
    before = infer(likelihood, chain, trait)
    likelihood[:2] = likelihood[:2, :, ::-1]
    after = infer(likelihood, chain, trait)
    np.testing.assert_allclose(before.others[0].chance, after.others[0].chance)
    assert np.abs(before.others[1].chance - after.others[1].chance).max() > 1e-3


def test_intervals_of_drivers_cover_their_angles(choices):
    """90 % intervals of 240 drivers, of a population that is inferred too."""
    rng = np.random.default_rng(5)
    angles = rng.normal(30.0, 30.0, 240)
    table = choices(angles, each=10, seed=6)
    trait = angle_trait(15.0, strengths=(0.35, 0.5, 0.7, 1.0, 1.4), scale=reward_scale(table))
    likelihood = driver_log_likelihood(evaluate(table, trait).log_likelihood, table.driver, 240)
    found = infer(likelihood, np.arange(240), trait)
    hits = []
    for angle, posterior in zip(angles, found.drivers, strict=True):
        ends = direction(trait.value, posterior.sum(axis=0), 0.9)
        off = (angle - ends.angle + 180.0) % 360.0 - 180.0
        hits.append(ends.low - ends.angle - 7.5 <= off <= ends.high - ends.angle + 7.5)
    assert 0.85 <= np.mean(hits) <= 0.985  # half a step of the grid on either side
    low, high = found.population.quantiles("spread", (0.025, 0.975))
    assert low <= 30.0 <= high


def test_drivers_alike_show_no_spread(choices):
    table = choices([30.0] * 60, each=16, seed=2)
    trait = angle_trait(15.0, strengths=(0.5, 0.7, 1.0, 1.4), scale=reward_scale(table))
    likelihood = driver_log_likelihood(evaluate(table, trait).log_likelihood, table.driver, 60)
    found = infer(likelihood, np.arange(60), trait)
    assert found.population.quantiles("spread", (0.5,))[0] <= 15.0


def test_quantiles_and_directions_by_hand():
    values, chance = np.array([3.0, 1.0, 2.0]), np.array([0.2, 0.5, 0.3])
    assert weighted_quantiles(values, chance, (0.0, 0.5, 0.51, 1.0)) == [1.0, 1.0, 2.0, 3.0]
    found = direction(np.array([170.0, -170.0]), np.array([0.5, 0.5]), 0.9)
    assert abs(found.angle) == pytest.approx(180.0)
    assert found.high - found.low == pytest.approx(20.0)
